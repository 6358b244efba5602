//! One stream's frames, without IO: repair, register, simplify, encode, measure.
//!
//! [`PreparedFrame::new`] is the edge: what passes it is a mesh that everything behind works on.
//! [`process`] takes one prepared frame and its predecessor, and gives what is delivered and
//! its metrics. Both are functions of their arguments: no clock, no log, no thread, and equal
//! inputs give equal bits. Whoever wants to know how long a stage takes passes a
//! [`StageObserver`] that has a clock.

mod attributes;
mod measure;
mod output;
mod prepare;
mod process;
mod quality;
mod register;
mod scene_cut;
mod settings;

pub use attributes::Attributes;
pub use measure::{add_distances, statistics};
pub use output::Output;
pub use prepare::{MIN_FACES, PreparedFrame, RawFrame, UnusableFrame};
pub use process::{
    Previous, ProcessFailed, ProcessedFrame, REGISTRATION_FAILED, process, process_registered,
};
pub use register::{CarriedOutput, Registered, register};
pub use scene_cut::SceneCut;
pub use settings::{AttributeWeight, InvalidSettings, Settings, TargetSize, TrackingStrength};

/// The stages of a frame's way through the pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Welding and the rest of the repair.
    Repair,
    /// Registration of the previous frame.
    Register,
    /// Edge collapses.
    Simplify,
    /// Draco.
    Encode,
    /// The distances.
    Measure,
}

/// Is told when a stage ends; the next one starts at once.
pub trait StageObserver {
    /// `stage` has just ended.
    fn ended(&mut self, stage: Stage);
}

/// For callers that do not want to know.
impl StageObserver for () {
    fn ended(&mut self, _stage: Stage) {}
}

#[cfg(test)]
mod tests;
