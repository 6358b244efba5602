//! Why a registration could not be computed.

/// People come and go and swing things; a frame a hundred times larger is another unit, and
/// looking for closest points from that far away would take minutes.
pub(super) const MAX_SIZE_FACTOR: f64 = 20.0;

/// Why a registration could not be computed.
///
/// Running out of iterations is not an error, and neither is a bad fit: see the result's
/// residual.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegistrationError {
    /// `source[i]` must pair with `target[i]`, so the lengths must agree.
    #[error("{source_count} source points but {target_count} target points")]
    CountMismatch {
        /// Points on the source side.
        source_count: usize,
        /// Points on the target side.
        target_count: usize,
    },
    /// Too few pairs to determine six degrees of freedom.
    #[error("too few correspondences: {found}, where at least {needed} are needed")]
    TooFewCorrespondences {
        /// Pairs that were left after rejection.
        found: usize,
        /// How many the step that failed must have.
        needed: usize,
    },
    /// One mesh is many times the size of the other: they are not frames of one scene.
    #[error(
        "the frames differ in size by a factor of {factor:.0}, at most {MAX_SIZE_FACTOR} is \
         taken for motion"
    )]
    SizeMismatch {
        /// The larger bounding box's diagonal over the smaller one's.
        factor: f64,
    },
    /// A mesh without faces has no surface to be registered.
    #[error("the {which} mesh has no faces")]
    Empty {
        /// `source` or `target`.
        which: &'static str,
    },
    /// The sparse system could not be factorised.
    #[error("the system of {unknowns} unknowns could not be factorised: {reason}")]
    Factorisation {
        /// Rows of the matrix.
        unknowns: usize,
        /// What the factorisation said.
        reason: String,
    },
    /// A number that is not finite came out of a solve.
    #[error("the {step} step gave a position that is not finite")]
    NotFinite {
        /// `rigid` or `non-rigid`.
        step: &'static str,
    },
}
