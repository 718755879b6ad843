//! The corrections of a run's cameras, and where they come from.

/// The corrections of a run's cameras, and where they come from. `C` is their form: a calibration,
/// or the numbers of a checkpoint.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Corrections<C> {
    /// Whether cameras are corrected is undecided.
    #[default]
    Undecided,
    /// None: the cameras stay as given.
    Given,
    /// The loss refines them.
    Refined(C),
    /// Keypoint matches adjusted them before the first iteration. They are fixed from then on.
    Adjusted(C),
}

impl<C> Corrections<C> {
    /// The corrections; `None` if the cameras are as given.
    pub fn get(&self) -> Option<&C> {
        match self {
            Corrections::Refined(own) | Corrections::Adjusted(own) => Some(own),
            Corrections::Undecided | Corrections::Given => None,
        }
    }

    /// The corrections by keypoint matches.
    pub fn adjusted(&self) -> Option<&C> {
        if let Corrections::Adjusted(own) = self { Some(own) } else { None }
    }

    /// The corrections that the loss refines.
    pub fn refined_mut(&mut self) -> Option<&mut C> {
        if let Corrections::Refined(own) = self { Some(own) } else { None }
    }

    /// Whether camera correction is undecided.
    pub fn is_undecided(&self) -> bool {
        matches!(self, Corrections::Undecided)
    }

    /// The same corrections in another form.
    pub fn map<D>(&self, form: impl Fn(&C) -> D) -> Corrections<D> {
        match self {
            Corrections::Undecided => Corrections::Undecided,
            Corrections::Given => Corrections::Given,
            Corrections::Refined(own) => Corrections::Refined(form(own)),
            Corrections::Adjusted(own) => Corrections::Adjusted(form(own)),
        }
    }
}
