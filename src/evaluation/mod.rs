//! The experiment of section 4 of the Tracked QEM paper, on any sequence of frames.
//!
//! For each pair of consecutive frames (k-1, k), frame k-1 is registered onto frame k once.
//! Frame k is then simplified by the original QEM (`off`) and with every tracking mode in
//! question, and every result is measured against the same two meshes: the registered frame
//! k-1 and frame k. What is measured is the mesh as players see it, after Draco.
//!
//! [`Protocol`] takes the pairs one by one and holds figures only; [`Evaluation`] is what comes
//! out, and what is written as JSON; [`terminal`] and [`report`] show it to people. Nothing here
//! reads a clock or a file, and equal inputs give equal bytes.
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
mod measure;
mod plots;
mod protocol;
mod published;
mod report;
mod results;
mod surface_samples;
mod tables;

pub use chart::PlotFailed;
pub use plots::{Plot, plots};
pub use protocol::{Plan, Protocol};
pub use report::{report, terminal};
pub use results::{
    Best, ByFrame, ByMeasure, Change, Evaluation, FramePair, Measure, Output, Run, Summary,
    TargetEvaluation,
};
