//! One frame's way through the pool.

use std::sync::Arc;
use std::time::Duration;

use steadymesh_mesh_io::{Format, Limits, ReadError, read};
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::metrics::{Quality, StageTimes};
use tokio::sync::oneshot;

use crate::compute::{ComputePool, JobPanicked, Length};
use crate::pipeline::{
    Output, PreparedFrame, ProcessFailed, ProcessedFrame, RawFrame, Registered, Settings, Stage,
    StageObserver, UnusableFrame, process_registered, register,
};
use crate::stopwatch::{Stopwatch, microseconds};
use crate::textures::{Made, SourceImage};

/// All that a frame is processed with.
#[derive(Debug)]
pub struct Job {
    /// Where it is done.
    pub pool: Arc<ComputePool>,
    /// How.
    pub settings: Settings,
    /// The frame.
    pub frame: Arc<PreparedFrame>,
    /// The frame before.
    pub previous: Option<Arc<PreparedFrame>>,
    /// How long what has been done took.
    pub times: StageTimes,
}

/// Why a frame did not come out.
#[derive(Debug)]
#[non_exhaustive]
pub enum Lost {
    /// It gave way to a newer one.
    Overload,
    /// Draco refused its part.
    Failed(ProcessFailed),
    /// A defect.
    Panicked,
}

/// What becomes of a frame.
pub type Outcome = Result<(ProcessedFrame, StageTimes), Lost>;

/// What is known of a frame beside what the pipeline finds out.
#[derive(Debug)]
pub struct Stamps {
    /// Its number.
    pub seq: u64,
    /// When it was captured, in microseconds since 1970, if the rig said so.
    pub capture_time_us: Option<u64>,
    /// How much of the processing it got.
    pub quality: Quality,
    /// The number of the frame before, if that was there.
    pub previous_seq: Option<u64>,
    /// How long each stage took.
    pub times: StageTimes,
    /// From its arrival to now.
    pub latency: Duration,
}

impl Stamps {
    /// The complete figures of a frame.
    #[must_use]
    pub fn stamp(self, mut metrics: FrameMetrics, texture: Option<&Made>) -> FrameMetrics {
        match texture {
            None | Some(Ok(None)) => {}
            Some(Ok(Some(texture))) => metrics.texture = Some(texture.figures.clone()),
            Some(Err(error)) => metrics.texture_error = Some(error.to_string()),
        }
        let has_reference = metrics.registration.is_some() && metrics.reset.is_none();
        metrics.seq = self.seq;
        metrics.capture_time_us = self.capture_time_us;
        metrics.quality = self.quality;
        metrics.reference_seq = self.previous_seq.filter(|_| has_reference);
        metrics.stage_us = self.times;
        metrics.latency_us = microseconds(self.latency);
        metrics
    }
}

/// Why a body is not a frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NotAFrame {
    /// It is not a mesh in this format, or too large a one.
    #[error(transparent)]
    Unreadable(#[from] ReadError),
    /// It is a mesh, but not one that can be worked on.
    #[error(transparent)]
    Unusable(#[from] UnusableFrame),
}

/// What became of the previous frame's registration: none if there was nothing to register.
#[derive(Debug, Default)]
pub struct Registration {
    registered: Option<Registered>,
    error: Option<String>,
}

impl Job {
    /// Registers, waits for the previous frame's result if that is needed, and does the rest.
    pub async fn run(mut self, previous_output: Option<oneshot::Receiver<Output>>) -> Outcome {
        let registration = self.register().await?;
        let output = match previous_output {
            Some(output) if self.wants_output(&registration) => output.await.ok(),
            Some(_) | None => None,
        };
        self.finish(registration, output).await
    }

    /// Whether what became of the previous frame takes part in the rest.
    #[must_use]
    pub fn wants_output(&self, registration: &Registration) -> bool {
        let is_of_use = |registered: &Registered| registered.scene_cut().is_none();
        registration.registered.as_ref().is_some_and(is_of_use) && self.settings.carries_output()
    }

    /// Does the rest.
    ///
    /// # Errors
    ///
    /// [`Lost`].
    pub async fn finish(self, registration: Registration, output: Option<Output>) -> Outcome {
        let Registration { registered, error } = registration;
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

    /// Registers the previous frame onto this one.
    ///
    /// # Errors
    ///
    /// [`Lost::Panicked`]: a registration that fails is a result.
    pub async fn register(&mut self) -> Result<Registration, Lost> {
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

/// A frame that has been read, ready for the rest.
#[derive(Debug)]
pub struct Prepared {
    /// The frame.
    pub frame: PreparedFrame,
    /// The image on it, if its body has one and it has texture coordinates.
    pub image: Option<SourceImage>,
    /// How long that took.
    pub times: StageTimes,
}

/// Parses and repairs a body.
///
/// # Errors
///
/// [`NotAFrame`] says what is wrong, and where.
pub fn prepare(body: &[u8], format: Format, limits: &Limits) -> Result<Prepared, NotAFrame> {
    let mut stopwatch = Stopwatch::start();
    let mesh = read(body, format, limits)?;
    // Without coordinates it cannot lie on the mesh.
    let image = mesh.image.as_ref();
    let image = image.filter(|_| mesh.texture_coordinates.is_some());
    let image = image.map(|image| SourceImage::new(image, body));
    stopwatch.parsed();
    let raw = RawFrame::from_mesh(mesh, body.len());
    let frame = PreparedFrame::new(raw, &mut stopwatch)?;
    let times = stopwatch.times();
    Ok(Prepared {
        frame,
        image,
        times,
    })
}
