//! What a stream's user chooses.

use steadymesh_draco::EncodeOptions;
use steadymesh_geometry::registration;
use steadymesh_proto::metrics::Tracking;
use steadymesh_proto::stream::MetricsMode;

/// How many faces are wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TargetSize {
    /// This many.
    Faces(usize),
    /// This share of the repaired frame's, above 0 and at most 1.
    Ratio(f64),
}

/// Why settings cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InvalidSettings {
    /// A closed surface has at least four faces.
    #[error(
        "target_faces is {found}: it must be from {} to {limit}",
        super::MIN_FACES
    )]
    TargetFaces {
        /// What was asked for.
        found: usize,
        /// The most faces that a frame may have.
        limit: usize,
    },
    /// A share of nothing or of more than there is.
    #[error("target_ratio is {found}: it must be above 0 and at most 1")]
    TargetRatio {
        /// What was asked for.
        found: f64,
    },
    /// Not a share.
    #[error("attribute_weight is {found}: it must be from 0 to 1")]
    AttributeWeight {
        /// What was asked for.
        found: f64,
    },
    /// Not a share.
    #[error("tracking_strength is {found}: it must be from 0 to 1")]
    TrackingStrength {
        /// What was asked for.
        found: f64,
    },
}

/// How strongly robust tracking holds a frame to the one before: 0 (not at all) to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingStrength(f64);

impl TrackingStrength {
    /// Checks a strength.
    ///
    /// # Errors
    ///
    /// [`InvalidSettings`] names the value and its range.
    pub fn new(found: f64) -> Result<Self, InvalidSettings> {
        // A NaN is in no range.
        if (0.0..=1.0).contains(&found) {
            Ok(Self(found))
        } else {
            Err(InvalidSettings::TrackingStrength { found })
        }
    }

    /// From 0 to 1.
    #[must_use]
    pub fn get(self) -> f64 {
        self.0
    }
}

impl Default for TrackingStrength {
    /// Halfway.
    fn default() -> Self {
        Self(0.5)
    }
}

/// How much attributes count in the simplification beside the shape, 0 (not at all) to 1.
///
/// A change of a color, a normal or a texture coordinate by its whole range counts as much as a
/// distance of this share of the diagonal of the frame's bounding box.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AttributeWeight(f64);

impl AttributeWeight {
    /// Checks a weight.
    ///
    /// # Errors
    ///
    /// [`InvalidSettings`] names the value and its range.
    pub fn new(found: f64) -> Result<Self, InvalidSettings> {
        // A NaN is in no range.
        if (0.0..=1.0).contains(&found) {
            Ok(Self(found))
        } else {
            Err(InvalidSettings::AttributeWeight { found })
        }
    }

    /// From 0 to 1.
    #[must_use]
    pub fn get(self) -> f64 {
        self.0
    }
}

impl TargetSize {
    /// Checks the size against the most faces that a frame may have.
    ///
    /// # Errors
    ///
    /// [`InvalidSettings`] names the value and its range.
    pub fn check(self, max_faces: usize) -> Result<Self, InvalidSettings> {
        match self {
            Self::Faces(found) if !(super::MIN_FACES..=max_faces).contains(&found) => {
                Err(InvalidSettings::TargetFaces {
                    found,
                    limit: max_faces,
                })
            }
            // A NaN is not above 0 either.
            Self::Ratio(found) if !(0.0 < found && found <= 1.0) => {
                Err(InvalidSettings::TargetRatio { found })
            }
            usable => Ok(usable),
        }
    }

    /// The number of faces wanted of a frame that has `face_count`.
    #[must_use]
    pub fn faces_of(self, face_count: usize) -> usize {
        match self {
            Self::Faces(faces) => faces,
            Self::Ratio(ratio) => {
                ((face_count as f64 * ratio).round() as usize).max(super::MIN_FACES)
            }
        }
    }
}

/// How a stream's frames are processed.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// How many faces are wanted.
    pub target: TargetSize,
    /// Whether the previous frame takes part.
    pub tracking: Tracking,
    /// How much, if tracking is robust.
    pub tracking_strength: TrackingStrength,
    /// How much attributes count beside the shape.
    pub attribute_weight: AttributeWeight,
    /// Draco's quantization and speed.
    pub draco: EncodeOptions,
    /// How the previous frame is registered.
    pub registration: registration::Options,
    /// Whether a result that may be held is fitted to its frame: see
    /// [`simplification::Options::refines`](steadymesh_geometry::simplification::Options::refines).
    pub refines: bool,
    /// Which distances are measured; without them a frame costs less.
    pub metrics: MetricsMode,
}

impl Default for Settings {
    /// A tenth of a 40,000-face capture, tracked.
    fn default() -> Self {
        Self {
            target: TargetSize::Faces(4000),
            tracking: Tracking::Robust,
            tracking_strength: TrackingStrength::default(),
            attribute_weight: AttributeWeight::default(),
            draco: EncodeOptions::default(),
            registration: registration::Options::default(),
            refines: true,
            metrics: MetricsMode::Full,
        }
    }
}

impl Settings {
    /// Whether the previous frame is registered: to hold the frame to it, or to measure what full
    /// metrics have to say of it.
    #[must_use]
    pub fn registers(&self) -> bool {
        self.tracking != Tracking::Off || self.metrics == MetricsMode::Full
    }

    /// Whether what became of the previous frame is of use once that is registered: to hold the
    /// frame to it, or to measure what comes back.
    #[must_use]
    pub fn carries_output(&self) -> bool {
        self.tracking == Tracking::Robust || self.metrics != MetricsMode::Off
    }
}
