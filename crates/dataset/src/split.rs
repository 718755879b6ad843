//! Which views are held out where the data set does not say.

/// One view in this many is held out, beginning with the first.
const HELD_OUT: usize = 8;

/// Splits views into those to fit and every eighth to hold out; a set of one or two is fitted
/// whole.
pub(super) fn every_eighth<T>(views: Vec<T>) -> (Vec<T>, Vec<T>) {
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
    fn one_in_eight_is_held_out() {
        let (train, test) = every_eighth((0..16).collect());
        assert_eq!((train.len(), test), (14, vec![0, 8]));
        assert_eq!(every_eighth(vec![1, 2]), (vec![1, 2], vec![]));
    }
}
