//! One frame's way through the pool.

use std::sync::Arc;

use steadymesh_mesh_io::{Limits, read};
use steadymesh_proto::metrics::StageTimes;
use tokio::sync::oneshot;

use crate::compute::{ComputePool, JobPanicked, Length};
use crate::pipeline::{
    Output, PreparedFrame, ProcessFailed, ProcessedFrame, RawFrame, Registered, Settings, Stage,
    StageObserver, process_registered, register,
};
use crate::stopwatch::Stopwatch;

use super::{Refused, Submission};

/// All that a frame is processed with.
pub(super) struct Job {
    pub pool: Arc<ComputePool>,
    pub settings: Settings,
    pub frame: Arc<PreparedFrame>,
    pub previous: Option<Arc<PreparedFrame>>,
    pub previous_output: Option<oneshot::Receiver<Output>>,
    pub times: StageTimes,
}

/// Why a frame did not come out.
#[derive(Debug)]
pub(super) enum Lost {
    Overload,
    Failed(ProcessFailed),
    Panicked,
}

pub(super) type Outcome = Result<(ProcessedFrame, StageTimes), Lost>;

/// What became of the previous frame's registration: none if there was nothing to register.
#[derive(Default)]
struct Registration {
    registered: Option<Registered>,
    error: Option<String>,
}

impl Job {
    /// Registers, waits for the previous frame's result if that is needed, and does the rest.
    pub async fn run(mut self) -> Outcome {
        let Registration { registered, error } = self.register().await?;
        let is_of_use = |registered: &Registered| registered.scene_cut().is_none();
        let carries = registered.as_ref().is_some_and(is_of_use) && self.settings.carries_output();
        let output = match self.previous_output {
            Some(output) if carries => output.await.ok(),
            Some(_) | None => None,
        };
        let (frame, settings, times) = (self.frame, self.settings, self.times);
        let rest = move || {
            let output = output.as_ref();
            let mut stopwatch = Stopwatch::resume(times);
            process_registered(&frame, registered, output, &settings, &mut stopwatch).map(
                |mut processed| {
                    if let Some(error) = error {
                        processed.set_registration_error(error);
                    }
                    (processed, stopwatch.times())
                },
            )
        };
        match self.pool.run(Length::Long, rest).await {
            Ok(Ok(processed)) => Ok(processed),
            Ok(Err(failed)) => Err(Lost::Failed(failed)),
            Err(JobPanicked) => Err(Lost::Panicked),
        }
    }

    async fn register(&mut self) -> Result<Registration, Lost> {
        let Some(previous) = self.previous.take() else {
            return Ok(Registration::default());
        };
        if !self.settings.registers() {
            return Ok(Registration::default());
        }
        let (target, options) = (Arc::clone(&self.frame), self.settings.registration.clone());
        let times = self.times.clone();
        let registration = move || {
            let mut stopwatch = Stopwatch::resume(times);
            let registered = register(&previous, &target, &options);
            stopwatch.ended(Stage::Register);
            (registered, stopwatch.times())
        };
        let done = self.pool.run(Length::Long, registration).await;
        let (registered, times) = done.map_err(|JobPanicked| Lost::Panicked)?;
        self.times = times;
        Ok(match registered {
            Ok(registered) => Registration {
                registered: Some(registered),
                error: None,
            },
            Err(error) => Registration {
                registered: None,
                error: Some(error.to_string()),
            },
        })
    }
}

/// Parses and repairs a body.
pub(super) fn prepare(
    submission: &Submission,
    limits: &Limits,
) -> Result<(PreparedFrame, StageTimes), Refused> {
    let mut stopwatch = Stopwatch::start();
    let mesh = read(&submission.bytes, submission.format, limits)?;
    stopwatch.parsed();
    let raw = RawFrame {
        positions: mesh.positions,
        faces: mesh.faces,
        byte_count: submission.bytes.len(),
    };
    let frame = PreparedFrame::new(raw, &mut stopwatch)?;
    Ok((frame, stopwatch.times()))
}
