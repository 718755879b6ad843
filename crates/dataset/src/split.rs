//! The training/held-out split: that of data sets that have none of their own, and that of a run.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// One view of this many is held out, the first of each group.
pub const HELD_OUT: usize = 8;

/// Data sets with fewer views are fitted whole: each view shows a part that the others do not.
const FEW: usize = 20;

/// The least number of views to fit.
const LEAST_FITTED: usize = 2;

/// The views to hold out: as text `auto`, `none` or a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum HeldOut {
    /// Those of the data set's own split. Without one, views 0, 8, 16, … of 20 views and more, and
    /// none of fewer.
    #[default]
    Auto,
    /// None: all views are fitted, also those that the data set holds out.
    None,
    /// This many of all views, evenly spread over their order.
    Count(u32),
}

impl HeldOut {
    /// Whether this is the choice without an option; a file of a run may leave it out.
    pub fn is_auto(&self) -> bool {
        *self == HeldOut::Auto
    }

    const EXPECTED: &'static str = "auto, none or a number of views";

    /// Splits the views of a data set into those to fit and those held out. `own` are those that the
    /// data set holds out, if it does.
    ///
    /// # Errors
    /// The largest number that can be held out, if there are too few views.
    pub(crate) fn split<T>(
        self,
        views: Vec<T>,
        own: Option<Vec<T>>,
    ) -> Result<(Vec<T>, Vec<T>), usize> {
        let count = match (self, &own) {
            (HeldOut::Auto, Some(_)) => return Ok((views, own.unwrap_or_default())),
            (HeldOut::Auto, None) if views.len() < FEW => 0,
            (HeldOut::Auto, None) => return Ok(split_at(views, |i| i % HELD_OUT == 0)),
            (HeldOut::None, _) => 0,
            (HeldOut::Count(count), _) => count as usize,
        };
        let all: Vec<T> = views.into_iter().chain(own.into_iter().flatten()).collect();
        let (len, most) = (all.len(), all.len().saturating_sub(LEAST_FITTED));
        if count > most {
            return Err(most);
        }
        // The i-th of the held-out views is number i len/count, rounded down.
        Ok(split_at(all, |i| count > 0 && (i * count).div_ceil(len) * len / count == i))
    }
}

/// The other views, and those with these numbers.
fn split_at<T>(views: Vec<T>, is_held_out: impl Fn(usize) -> bool) -> (Vec<T>, Vec<T>) {
    let (mut train, mut test) = (Vec::new(), Vec::new());
    for (i, view) in views.into_iter().enumerate() {
        if is_held_out(i) { test.push(view) } else { train.push(view) }
    }
    (train, test)
}

impl From<HeldOut> for String {
    fn from(choice: HeldOut) -> String {
        choice.to_string()
    }
}

impl TryFrom<String> for HeldOut {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse().map_err(|_| format!("{text:?}, which is not {}", Self::EXPECTED))
    }
}

impl fmt::Display for HeldOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            HeldOut::Auto => f.write_str("auto"),
            HeldOut::None => f.write_str("none"),
            HeldOut::Count(count) => count.fmt(f),
        }
    }
}

impl FromStr for HeldOut {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(HeldOut::Auto),
            "none" => Ok(HeldOut::None),
            _ => {
                let count = text.parse().map(HeldOut::Count);
                count.map_err(|_| format!("expected {}", Self::EXPECTED))
            }
        }
    }
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
    fn views_are_held_out_as_chosen() {
        let views = |count: usize| (0..count).collect::<Vec<usize>>();
        let split = |choice: HeldOut, count| choice.split(views(count), None).unwrap();
        assert_eq!(split(HeldOut::Auto, 20).1, [0, 8, 16]);
        assert_eq!(split(HeldOut::Auto, 19), (views(19), vec![]));
        assert_eq!(split(HeldOut::None, 50), (views(50), vec![]));
        assert_eq!(split(HeldOut::Count(2), 9), (vec![1, 2, 3, 5, 6, 7, 8], vec![0, 4]));
        assert_eq!(HeldOut::Count(8).split(views(9), None), Err(7));
        assert_eq!(HeldOut::Count(1).split(views(1), None), Err(0));
        for (len, count) in [(3, 1), (7, 5), (100, 13), (1000, 998)] {
            let found = split(HeldOut::Count(count), len).1.len();
            assert_eq!(found, count as usize, "{count} of {len}");
        }
        // A split of the data set's own.
        let own = || Some(vec![7, 8]);
        assert_eq!(HeldOut::Auto.split(views(5), own()), Ok((views(5), vec![7, 8])));
        assert_eq!(HeldOut::None.split(views(2), own()), Ok((vec![0, 1, 7, 8], vec![])));
        assert_eq!(HeldOut::Count(2).split(views(2), own()), Ok((vec![1, 8], vec![0, 7])));
    }

    #[test]
    fn choices_are_read_as_they_are_written() {
        for choice in [HeldOut::Auto, HeldOut::None, HeldOut::Count(0), HeldOut::Count(12)] {
            assert_eq!(choice.to_string().parse(), Ok(choice));
        }
        for wrong in ["", "-1", "1.5", "some"] {
            assert!(wrong.parse::<HeldOut>().unwrap_err().contains("number of views"), "{wrong}");
        }
    }
}
