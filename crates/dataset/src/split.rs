//! The training/held-out split of data sets that have none of their own.

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_eighth_view_is_held_out() {
        let (train, test) = every_eighth((0..16).collect());
        assert_eq!((train.len(), test), (14, vec![0, 8]));
        assert_eq!(every_eighth(vec![1, 2]), (vec![1, 2], vec![]));
    }
}
