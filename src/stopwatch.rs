//! The clock that the pipeline does not have.

use std::time::Instant;

use steadymesh_proto::metrics::StageTimes;

use crate::pipeline::{Stage, StageObserver};
use crate::telemetry::traces;

/// Notes how long each stage of a frame takes.
#[derive(Debug)]
pub struct Stopwatch {
    last: Instant,
    times: StageTimes,
}

impl Stopwatch {
    /// Starts with the parsing of a frame.
    #[must_use]
    pub fn start() -> Self {
        Self::resume(StageTimes::default())
    }

    /// Goes on after a pause that belongs to no stage.
    #[must_use]
    pub fn resume(times: StageTimes) -> Self {
        let last = Instant::now();
        Self { last, times }
    }

    /// The frame has been parsed.
    pub fn parsed(&mut self) {
        self.times.parse = self.lap("parse");
    }

    /// The times of the stages so far.
    #[must_use]
    pub fn times(self) -> StageTimes {
        self.times
    }

    fn lap(&mut self, stage: &'static str) -> u64 {
        let now = Instant::now();
        let elapsed = now.duration_since(self.last);
        self.last = now;
        traces::stage(stage, elapsed);
        microseconds(elapsed)
    }
}

impl StageObserver for Stopwatch {
    fn ended(&mut self, stage: Stage) {
        let name = match stage {
            Stage::Repair => "repair",
            Stage::Register => "register",
            Stage::Simplify => "simplify",
            Stage::Encode => "encode",
            Stage::Measure => "measure",
        };
        let elapsed = self.lap(name);
        let slot = match stage {
            Stage::Repair => &mut self.times.repair,
            Stage::Register => &mut self.times.register,
            Stage::Simplify => &mut self.times.simplify,
            Stage::Encode => &mut self.times.encode,
            Stage::Measure => &mut self.times.measure,
        };
        *slot += elapsed;
    }
}

/// A duration in whole microseconds.
#[must_use]
pub fn microseconds(duration: std::time::Duration) -> u64 {
    u64::try_from(duration.as_micros()).unwrap_or(u64::MAX)
}
