//! The training/held-out split: that of data sets that have none of their own, and that of a run.

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

/// Views in the order of the names of a run.
pub(crate) struct Placed<T> {
    /// The views with the names of those to fit, and of those held out.
    pub(crate) lists: [Vec<T>; 2],
    /// The other views, from the list to fit and from that held out.
    pub(crate) others: [Vec<T>; 2],
    /// The first name without a view.
    pub(crate) missing: Option<String>,
}

/// Puts views to fit and views held out into lists by these names. A view that is in the other list
/// now is found there.
pub(crate) fn place<T>(
    views: [Vec<T>; 2],
    names: [&[String]; 2],
    name_of: impl Fn(&T) -> &str,
) -> Placed<T> {
    let mut pool = views.map(|list| list.into_iter().map(Some).collect::<Vec<_>>());
    let mut take = |name: &str, list: usize| {
        let is_it = |view: &&mut Option<T>| view.as_ref().is_some_and(|view| name_of(view) == name);
        pool[list].iter_mut().find(is_it)?.take()
    };
    // The same name may stand in both lists, for a photograph in each of two folders.
    let same_list =
        [0, 1].map(|list| names[list].iter().map(|name| take(name, list)).collect::<Vec<_>>());
    let (mut lists, mut missing) = ([Vec::new(), Vec::new()], None);
    for (list, found) in same_list.into_iter().enumerate() {
        for (name, view) in names[list].iter().zip(found) {
            match view.or_else(|| take(name, 1 - list)) {
                Some(view) => lists[list].push(view),
                None => missing = missing.or_else(|| Some(name.clone())),
            }
        }
    }
    Placed { lists, others: pool.map(|list| list.into_iter().flatten().collect()), missing }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn views_are_placed_by_their_names() {
        let check = |views: [&[&'static str]; 2], wanted: [&[&str]; 2]| {
            let wanted = wanted.map(names);
            place(views.map(<[_]>::to_vec), [&wanted[0], &wanted[1]], |view| view)
        };
        // A photograph came in front of the others: the split by number is another one.
        let Placed { lists, others, missing } =
            check([&["1", "2"], &["new", "0"]], [&["1", "2"], &["0"]]);
        assert_eq!(lists, [vec!["1", "2"], vec!["0"]]);
        assert_eq!((others, missing), ([vec![], vec!["new"]], None));
        let Placed { lists, others, .. } = check([&["0", "2"], &["1"]], [&["1", "2"], &["0"]]);
        assert_eq!((lists, others), ([vec!["1", "2"], vec!["0"]], [vec![], vec![]]));
        let Placed { lists, missing, .. } = check([&["2"], &["1"]], [&["1", "2"], &["0"]]);
        assert_eq!((lists, missing), ([vec!["1", "2"], vec![]], Some("0".to_owned())));
        // Two folders with the same names of files.
        let Placed { lists, .. } = check([&["0", "1"], &["0"]], [&["0", "1"], &["0"]]);
        assert_eq!(lists, [vec!["0", "1"], vec!["0"]]);
        let Placed { missing, .. } = check([&["0", "1"], &[]], [&["0", "1"], &["0"]]);
        assert_eq!(missing, Some("0".to_owned()));
    }

    #[test]
    fn every_eighth_view_is_held_out() {
        let (train, test) = every_eighth((0..16).collect());
        assert_eq!((train.len(), test), (14, vec![0, 8]));
        assert_eq!(every_eighth(vec![1, 2]), (vec![1, 2], vec![]));
    }
}
