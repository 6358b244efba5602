//! The experiment of section 4 of the Tracked QEM paper, on any sequences of frames, and what the
//! paper does not measure.
//!
//! For each pair of consecutive frames (k-1, k), frame k-1 is registered onto frame k once.
//! Frame k is then simplified by the original QEM (`off`) and with every tracking mode in
//! question, and every result is measured against the same two meshes: the registered frame
//! k-1 and frame k. What is measured is the mesh as players see it, after Draco.
//!
//! [`Protocol`] takes the pairs of a sequence one by one and holds figures and few meshes;
//! [`Evaluation`] is what comes out, and what is written as JSON; [`terminal`], [`report`] and
//! [`plots`] show it to people. Nothing here reads a clock or a file, and equal inputs give equal
//! bytes.
//!
//! [`KnownMotion`] is a sequence that says where everything goes, so that consistency can be
//! measured without the registration that tracking relies on.
//!
//! Decided where the paper is silent:
//!
//! - *Best* (its Tables 1 and 2): for each algorithm on its own, the pair with the smallest sum
//!   of the mean distances to frame k-1 and to frame k, relative to the diagonal.
//! - *Average* (Tables 3 and 4): the mean over the pairs of each average, variance and mean
//!   square; standard deviation and root mean square are the roots of those means, as the
//!   numbers in the paper's tables are.
//! - A pair whose registration failed takes no part in either.
//! - Averages over the result's *vertices*, as the paper defines them, get smaller by removing
//!   vertices from bad places. Samples spread evenly over the result's surface and the
//!   distances in the other direction stand beside them.

mod aggregate;
mod chart;
mod distribution;
mod known_motion;
mod measure;
mod overview;
mod pictures;
mod plots;
mod protocol;
mod published;
mod report;
mod results;
mod snapshots;
mod tables;

pub use chart::PlotFailed;
pub use known_motion::{KnownFrame, KnownMotion};
pub use plots::{Plot, file_words, plots};
pub use protocol::{Pair, Plan, Protocol, TrueMotion};
pub use report::{report, terminal};
pub use results::{
    Averages, Best, ByError, ByFrame, ByMeasure, Change, ConsistencySummary, Directions,
    Evaluation, FramePair, Measure, Output, Psnr, Run, Sequence, Summary, Target, TargetEvaluation,
};
pub use snapshots::{Snapshot, pictured_frames};
