//! The training/held-out split: that of data sets that have none of their own, and that of a run.

use std::collections::HashMap;

/// One view of this many is held out, the first of each group.
pub const HELD_OUT: usize = 8;

/// Splits views into those to fit and those held out: views 0, 8, 16, … are held out. A set of one
/// or two views is fitted whole.
pub(crate) fn every_eighth<T>(views: Vec<T>) -> (Vec<T>, Vec<T>) {
    if views.len() < 3 {
        return (views, Vec::new());
    }
    let (mut train, mut test) = (Vec::new(), Vec::new());
    for (i, view) in views.into_iter().enumerate() {
        if i % HELD_OUT == 0 { test.push(view) } else { train.push(view) }
    }
    (train, test)
}

/// The views with these names, in this order, of those to fit and of those held out. A view that is
/// in the other list now is found there. Views without a place in the lists are left over.
///
/// # Errors
/// The first name without a view.
pub(crate) fn by_names<T>(
    views: [Vec<T>; 2],
    names: [&[String]; 2],
    name_of: impl Fn(&T) -> &str,
) -> Result<([Vec<T>; 2], usize), String> {
    // The same name may stand in both lists, for a photograph in each of two folders.
    let pair = |list| move |view| (list, Some(view));
    let [train, test] = views;
    let mut pool: Vec<_> =
        train.into_iter().map(pair(0)).chain(test.into_iter().map(pair(1))).collect();
    let mut take = |name: &str, from: usize| {
        let is_it = |view: &Option<T>| view.as_ref().is_some_and(|view| name_of(view) == name);
        pool.iter_mut().find(|(list, view)| *list == from && is_it(view))?.1.take()
    };
    let same_list =
        [0, 1].map(|list| names[list].iter().map(|name| take(name, list)).collect::<Vec<_>>());
    let mut lists = [Vec::new(), Vec::new()];
    for (list, found) in same_list.into_iter().enumerate() {
        for (name, view) in names[list].iter().zip(found) {
            let view = view.or_else(|| take(name, 1 - list)).ok_or_else(|| name.clone())?;
            lists[list].push(view);
        }
    }
    Ok((lists, pool.iter().filter(|(_, view)| view.is_some()).count()))
}

/// Views of another data set, with those of these names in the same lists and in the same order as
/// there. The others stay where they are, behind them.
pub(crate) fn like<T>(
    views: [Vec<T>; 2],
    names: [&[String]; 2],
    name_of: impl Fn(&T) -> &str,
) -> [Vec<T>; 2] {
    let mut places: HashMap<&str, (usize, usize)> = HashMap::new();
    for (list, names) in names.into_iter().enumerate() {
        for (number, name) in names.iter().enumerate() {
            places.entry(name).or_insert((list, number));
        }
    }
    let mut lists = [Vec::new(), Vec::new()];
    for (own, views) in views.into_iter().enumerate() {
        for view in views {
            let &(list, number) = places.get(name_of(&view)).unwrap_or(&(own, usize::MAX));
            lists[list].push((number, view));
        }
    }
    lists.map(|mut list| {
        list.sort_by_key(|(number, _)| *number);
        list.into_iter().map(|(_, view)| view).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn views_are_split_by_their_names() {
        let split = |views: [&[&'static str]; 2], wanted: [&[&str]; 2]| {
            let wanted = wanted.map(names);
            by_names(views.map(<[_]>::to_vec), [&wanted[0], &wanted[1]], |view| view)
        };
        // A photograph came in front of the others: the split by number is another one.
        let found = split([&["1", "2"], &["new", "0"]], [&["1", "2"], &["0"]]);
        assert_eq!(found, Ok(([vec!["1", "2"], vec!["0"]], 1)));
        let found = split([&["0", "2"], &["1"]], [&["1", "2"], &["0"]]);
        assert_eq!(found, Ok(([vec!["1", "2"], vec!["0"]], 0)));
        assert_eq!(split([&["2"], &["1"]], [&["1", "2"], &["0"]]), Err("0".to_owned()));
        // Two folders with the same names of files.
        let found = split([&["0", "1"], &["0"]], [&["0", "1"], &["0"]]);
        assert_eq!(found, Ok(([vec!["0", "1"], vec!["0"]], 0)));
        assert_eq!(split([&["0", "1"], &[]], [&["0", "1"], &["0"]]), Err("0".to_owned()));
    }

    #[test]
    fn views_to_fit_are_not_held_out_in_another_data_set() {
        let found = like(
            [vec!["1", "new", "3"], vec!["2", "other"]],
            [&names(&["1", "2"]), &names(&["3"])],
            |view| view,
        );
        assert_eq!(found, [vec!["1", "2", "new"], vec!["3", "other"]]);
    }

    #[test]
    fn every_eighth_view_is_held_out() {
        let (train, test) = every_eighth((0..16).collect());
        assert_eq!((train.len(), test), (14, vec![0, 8]));
        assert_eq!(every_eighth(vec![1, 2]), (vec![1, 2], vec![]));
    }
}
