//! The clock that the pipeline does not have.

use std::time::Instant;

use steadymesh_proto::metrics::StageTimes;

use crate::pipeline::{Stage, StageObserver};

/// Notes how long each stage of a frame takes.
pub(super) struct Stopwatch {
    started: Instant,
    last: Instant,
    times: StageTimes,
}

impl Stopwatch {
    /// Starts with the parsing of a frame.
    pub fn start() -> Self {
        let now = Instant::now();
        Self {
            started: now,
            last: now,
            times: StageTimes::default(),
        }
    }

    /// The frame has been parsed.
    pub fn parsed(&mut self) {
        self.times.parse = self.lap();
    }

    /// The stages' times, and the time since the start, in microseconds.
    pub fn finish(self) -> (StageTimes, u64) {
        let total = self.started.elapsed().as_micros();
        (self.times, u64::try_from(total).unwrap_or(u64::MAX))
    }

    fn lap(&mut self) -> u64 {
        let now = Instant::now();
        let elapsed = now.duration_since(self.last).as_micros();
        self.last = now;
        u64::try_from(elapsed).unwrap_or(u64::MAX)
    }
}

impl StageObserver for Stopwatch {
    fn ended(&mut self, stage: Stage) {
        let elapsed = self.lap();
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
