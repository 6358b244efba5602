//! The experiment, pair by pair.

use std::ops::Range;

use steadymesh_geometry::TriangleMesh;
use steadymesh_geometry::mesh::{BoundingBox, EdgeTable};
use steadymesh_geometry::metrics::consistency;
use steadymesh_proto::metrics::{Consistency, Statistics, Tracking};
use steadymesh_proto::stream::MetricsMode;

use crate::pipeline::{
    PreparedFrame, ProcessFailed, ProcessedFrame, REGISTRATION_FAILED, Registered, Settings,
    TargetSize, process, process_registered, register, statistics,
};

use super::aggregate::{PairFigures, averages, best, change};
use super::distribution::Distribution;
use super::measure::{Clouds, Distances, Reference, hausdorff, measure};
use super::results::{
    ByFrame, ByMeasure, FRAMES_PER_SECOND, FramePair, Measure, Output, Run, Sequence,
    TargetEvaluation,
};
use super::snapshots::Snapshot;

/// What is to be compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Sizes, each of them usable ([`TargetSize::check`]).
    pub targets: Vec<TargetSize>,
    /// The tracking modes to be compared with the original QEM, which is always there.
    pub modes: Vec<Tracking>,
    /// How frames are registered and encoded.
    pub settings: Settings,
}

/// Two consecutive frames.
#[derive(Clone, Copy)]
pub struct Pair<'a> {
    /// The number of frame k.
    pub seq: u64,
    /// Frame k-1.
    pub previous: &'a PreparedFrame,
    /// Frame k.
    pub current: &'a PreparedFrame,
    /// Carries a result for frame k-1 along the true motion, where that is known.
    pub true_motion: Option<&'a TrueMotion<'a>>,
}

/// From a mesh near frame k-1 to the same mesh near frame k; none if it cannot be carried.
pub type TrueMotion<'a> = dyn Fn(&TriangleMesh) -> Option<TriangleMesh> + 'a;

/// The evaluation of a sequence under way. It holds figures, and of meshes only each run's last
/// result and those that are pictured.
#[derive(Debug)]
pub struct Protocol {
    settings: Settings,
    pairs: Vec<FramePair>,
    targets: Vec<TargetUnderWay>,
}

#[derive(Debug)]
struct TargetUnderWay {
    size: TargetSize,
    pictured: Range<u64>,
    runs: Vec<RunUnderWay>,
}

#[derive(Debug)]
struct RunUnderWay {
    tracking: Tracking,
    outputs: Vec<Output>,
    distribution: ByMeasure<ByFrame<Distribution>>,
    snapshots: Vec<Snapshot>,
    /// The number of the last frame that was simplified, and what became of it.
    last: Option<(u64, crate::pipeline::Output)>,
}

/// One simplified frame and its raw distances.
struct Measured {
    output: Output,
    distances: Option<Distances>,
}

/// A pair, registered, and what its results are measured against.
struct RegisteredPair<'a> {
    frames: Pair<'a>,
    diagonal: f64,
    registered: Option<Registered>,
    /// None if a mesh has no faces, which does not come this far.
    references: Option<ByFrame<Reference<'a>>>,
    clouds: Option<Clouds>,
}

impl Protocol {
    /// Starts without any pair. The results of frames `pictured` are kept for pictures, for the
    /// first of the sizes.
    #[must_use]
    pub fn new(plan: Plan, pictured: Range<u64>) -> Self {
        let mut modes = vec![Tracking::Off];
        for mode in plan.modes {
            if !modes.contains(&mode) {
                modes.push(mode);
            }
        }
        let run = |&tracking: &Tracking| RunUnderWay {
            tracking,
            outputs: Vec::new(),
            distribution: ByMeasure::default(),
            snapshots: Vec::new(),
            last: None,
        };
        let target = |(index, size)| TargetUnderWay {
            size,
            pictured: if index == 0 { pictured.clone() } else { 0..0 },
            runs: modes.iter().map(run).collect(),
        };
        Self {
            settings: plan.settings,
            pairs: Vec::new(),
            targets: plan.targets.into_iter().enumerate().map(target).collect(),
        }
    }

    /// Adds a frame and its predecessor. Returns the predecessor as it was registered: the mesh
    /// that was measured against, none if the registration failed or found a scene cut.
    ///
    /// # Errors
    ///
    /// [`ProcessFailed`] if Draco refuses its part.
    pub fn add_pair(&mut self, pair: Pair<'_>) -> Result<Option<TriangleMesh>, ProcessFailed> {
        let (previous, current) = (pair.previous, pair.current);
        let (registered, registration_error) =
            match register(previous, current, &self.settings.registration) {
                Ok(registered) => (Some(registered), None),
                Err(error) => (None, Some(error.to_string())),
            };
        let reset = match &registered {
            Some(registered) => registered.scene_cut().map(|cut| cut.to_string()),
            None => Some(REGISTRATION_FAILED.to_owned()),
        };
        let figures = registered.as_ref().map(|r| r.figures.clone());
        let registered = registered.filter(|_| reset.is_none());
        let mesh = registered.as_ref().map(|r| r.mesh.clone());
        let bounds = current.bounds();
        self.pairs.push(FramePair {
            seq: pair.seq,
            faces: current.mesh().face_count(),
            bbox_diagonal: bounds.diagonal(),
            mpeg_peak: mpeg_peak(bounds),
            registration: figures,
            registration_error,
            reset,
        });
        let pair = RegisteredPair {
            frames: pair,
            diagonal: bounds.diagonal(),
            references: references(current.mesh(), mesh.as_ref()),
            clouds: Clouds::new(current.mesh()),
            registered,
        };
        for target in &mut self.targets {
            target.add_pair(&pair, &self.settings)?;
        }
        Ok(mesh)
    }

    /// Sums up. `name` is that of the sequence, and `frames` are those of the files.
    #[must_use]
    pub fn finish(self, name: String, frames: Vec<String>) -> Sequence {
        let targets = self.targets.into_iter();
        Sequence {
            name,
            frames,
            targets: targets.map(|target| target.finish(&self.pairs)).collect(),
            pairs: self.pairs,
        }
    }
}

impl TargetUnderWay {
    fn add_pair(
        &mut self,
        pair: &RegisteredPair<'_>,
        settings: &Settings,
    ) -> Result<(), ProcessFailed> {
        let mut measured = Vec::with_capacity(self.runs.len());
        for run in &mut self.runs {
            let settings = Settings {
                target: self.size,
                tracking: run.tracking,
                // Measured here, against trees that are built once for all runs.
                metrics: MetricsMode::Off,
                ..settings.clone()
            };
            let is_pictured = self.pictured.contains(&pair.frames.seq);
            measured.push(run.add_pair(pair, &settings, is_pictured)?);
        }
        self.add(measured, pair.diagonal);
        Ok(())
    }

    /// Adds a pair: what was measured, in the order of the runs.
    fn add(&mut self, measured: Vec<Measured>, diagonal: f64) {
        let compared = measured.iter().all(|m| is_compared(&m.output));
        for (run, Measured { output, distances }) in self.runs.iter_mut().zip(measured) {
            run.outputs.push(output);
            if let Some(distances) = distances.filter(|_| compared) {
                run.add_distances(&distances, diagonal);
            }
        }
    }

    fn finish(self, pairs: &[FramePair]) -> TargetEvaluation {
        let compared: Vec<bool> = (0..pairs.len())
            .map(|pair| self.runs.iter().all(|run| is_compared(&run.outputs[pair])))
            .collect();
        let mut runs: Vec<Run> = Vec::with_capacity(self.runs.len());
        for under_way in self.runs {
            let run = under_way.finish(pairs, &compared, runs.first());
            runs.push(run);
        }
        TargetEvaluation {
            target: self.size.into(),
            compared_pairs: compared.iter().filter(|&&compared| compared).count(),
            runs,
        }
    }
}

impl RunUnderWay {
    fn add_pair(
        &mut self,
        pair: &RegisteredPair<'_>,
        settings: &Settings,
        is_pictured: bool,
    ) -> Result<Measured, ProcessFailed> {
        let Pair {
            seq,
            previous,
            current,
            true_motion,
        } = pair.frames;
        let before = match self.last.take() {
            Some((last, output)) if last + 1 == seq => output,
            // A first frame is the original QEM in every mode.
            _ => process(previous, None, settings, &mut ())?.output,
        };
        let carried = pair.registered.as_ref().map(|r| r.carry(&before));
        let carried_truly = true_motion.and_then(|carry| carry(&before.mesh));
        let registered = pair.registered.clone();
        let out = process_registered(current, registered, Some(&before), settings, &mut ())?;
        let distances = pair
            .references
            .as_ref()
            .and_then(|r| measure(&out.output.mesh, r));
        let output = Output {
            psnr: pair.clouds.as_ref().and_then(|clouds| {
                let of_output = Clouds::new(&out.output.mesh)?;
                Some(clouds.psnr(&of_output, pair.diagonal))
            }),
            consistency: carried
                .as_ref()
                .and_then(|carried| consistency_of(carried.mesh()?, &out.output.mesh)),
            known_motion_consistency: carried_truly
                .as_ref()
                .and_then(|carried| consistency_of(carried, &out.output.mesh)),
            ..output(seq, &out, distances.as_ref())
        };
        if let Some(distances) = distances.as_ref().filter(|_| is_pictured) {
            let carried = carried.as_ref().and_then(|carried| carried.mesh());
            let carried = carried_truly.as_ref().or(carried);
            let distances = (distances, pair.diagonal);
            let snapshot = Snapshot::take(seq, &out.output.mesh, carried, distances);
            self.snapshots.push(snapshot);
        }
        self.last = Some((seq, out.output));
        Ok(Measured { output, distances })
    }

    fn add_distances(&mut self, distances: &Distances, diagonal: f64) {
        for measure in Measure::ALL {
            let (of_run, of_pair) = (self.distribution.get_mut(measure), distances.get(measure));
            of_run.current.add(&of_pair.current, diagonal);
            if let Some(previous) = &of_pair.previous {
                let of_run = of_run.previous.get_or_insert_default();
                of_run.add(previous, diagonal);
            }
        }
    }

    /// Sums up the `compared` pairs, also against the `original` if this is not it.
    fn finish(self, pairs: &[FramePair], compared: &[bool], original: Option<&Run>) -> Run {
        let figures: Vec<PairFigures<'_>> = (self.outputs.iter().zip(pairs))
            .zip(compared)
            .filter(|(_, compared)| **compared)
            .filter_map(|((output, pair), _)| {
                Some(PairFigures {
                    diagonal: pair.bbox_diagonal,
                    output,
                    distances: output.distances.as_ref()?,
                })
            })
            .collect();
        let (average, best) = (averages(&figures), best(&figures));
        let last_ten = figures
            .len()
            .checked_sub(LAST)
            .filter(|&from| 3 * LAST <= from);
        let average_of_last_ten = last_ten.and_then(|from| averages(&figures[from..]));
        let both = average
            .as_ref()
            .zip(original.and_then(|o| o.average.as_ref()));
        let average_change_percent = both.map(|(ours, original)| {
            let (ours, original) = (&ours.distances, &original.distances);
            ByMeasure::from_fn(|m| change(ours.get(m), original.get(m)))
        });
        let bests = best.as_ref().zip(original.and_then(|o| o.best.as_ref()));
        let best_change_percent = bests.map(|(ours, original)| {
            ByMeasure::from_fn(|m| change(&ours.get(m).summary, &original.get(m).summary))
        });
        let distribution = &self.distribution;
        Run {
            tracking: self.tracking,
            average_change_percent,
            best_change_percent,
            distribution: ByMeasure::from_fn(|m| distribution.get(m).map(Distribution::cumulative)),
            average,
            average_of_last_ten,
            best,
            outputs: self.outputs,
            snapshots: self.snapshots,
        }
    }
}

/// Errors that add up show in the last pairs of at least four times as many.
const LAST: usize = 10;

fn mpeg_peak(bounds: BoundingBox) -> f64 {
    3_f64.sqrt() * (bounds.max - bounds.min).max()
}

fn consistency_of(carried: &TriangleMesh, output: &TriangleMesh) -> Option<Consistency> {
    let found = consistency(carried, output)?;
    Some(Consistency {
        vertex_persistence: found.vertex_persistence,
        edge_persistence: found.edge_persistence,
        flicker: found.flicker,
    })
}

/// None if a mesh has no faces, which does not come this far.
fn references<'a>(
    current: &'a TriangleMesh,
    registered: Option<&'a TriangleMesh>,
) -> Option<ByFrame<Reference<'a>>> {
    Some(ByFrame {
        previous: registered.and_then(Reference::new),
        current: Reference::new(current)?,
    })
}

fn output(seq: u64, out: &ProcessedFrame, distances: Option<&Distances>) -> Output {
    let figures = &out.metrics.output;
    let summed_up = |distances: &Distances| -> ByMeasure<ByFrame<Statistics>> {
        ByMeasure::from_fn(|measure| distances.get(measure).map(|d| statistics(d)))
    };
    Output {
        seq,
        tracking: out.metrics.tracking,
        vertices: figures.vertices,
        faces: figures.faces,
        target_reached: figures.target_reached,
        bytes: figures.bytes,
        mbit_per_second: 8e-6 * figures.bytes as f64 * FRAMES_PER_SECOND,
        non_manifold_edges: EdgeTable::of(out.output.mesh.faces()).non_manifold_count(),
        distances: distances.map(summed_up),
        hausdorff: distances.map(hausdorff),
        ..Output::default()
    }
}

/// Whether there is something to compare: distances to both frames.
fn is_compared(output: &Output) -> bool {
    let distances = output.distances.as_ref();
    distances.is_some_and(|d| d.surface_distance.previous.is_some())
}

#[cfg(test)]
mod tests {
    use super::super::Evaluation;
    use super::*;

    fn frame_pair(seq: u64, is_registered: bool) -> FramePair {
        FramePair {
            seq,
            faces: 1000,
            bbox_diagonal: 2.0,
            mpeg_peak: 3.0,
            registration: is_registered.then(Default::default),
            registration_error: (!is_registered).then(|| "a reason".to_owned()),
            reset: (!is_registered).then(|| REGISTRATION_FAILED.to_owned()),
        }
    }

    /// Every distance of the pair is `distance`.
    fn measured(seq: u64, is_registered: bool, distance: f64) -> Measured {
        let distances = ByMeasure::from_fn(|_| ByFrame {
            previous: is_registered.then(|| vec![distance; 10]),
            current: vec![distance; 10],
        });
        let sums = |m: Measure| distances.get(m).map(|d| statistics(d));
        Measured {
            output: Output {
                seq,
                vertices: 10,
                faces: 16,
                target_reached: true,
                bytes: 100,
                distances: Some(ByMeasure::from_fn(sums)),
                hausdorff: Some(distance),
                ..Output::default()
            },
            distances: Some(distances),
        }
    }

    fn sequence(pairs: &[(u64, bool)]) -> Sequence {
        let plan = Plan {
            targets: vec![TargetSize::Faces(16)],
            modes: vec![Tracking::Paper, Tracking::Off, Tracking::Paper],
            settings: Settings::default(),
        };
        let mut protocol = Protocol::new(plan, 0..0);
        for &(seq, is_registered) in pairs {
            let distance = seq as f64;
            let runs = [distance, distance / 2.0].map(|d| measured(seq, is_registered, d));
            protocol.targets[0].add(runs.into(), 2.0);
            protocol.pairs.push(frame_pair(seq, is_registered));
        }
        protocol.finish("a".to_owned(), Vec::new())
    }

    #[test]
    fn the_original_comes_first_and_every_mode_once() {
        let modes: Vec<Tracking> = sequence(&[]).targets[0]
            .runs
            .iter()
            .map(|run| run.tracking)
            .collect();
        assert_eq!(modes, [Tracking::Off, Tracking::Paper]);
    }

    #[test]
    fn a_pair_that_was_not_registered_is_listed_but_not_compared() {
        let sequence = sequence(&[(1, false), (2, true), (4, true)]);
        let target = &sequence.targets[0];
        assert_eq!(target.compared_pairs, 2);
        let run = &target.runs[1];
        assert_eq!(run.outputs.len(), 3);
        let distances = &run.average.as_ref().unwrap().distances;
        let average = distances.surface_distance.clone();
        assert_eq!(average.current.own_unit.mean, 1.5);
        assert_eq!(average.current.own_unit.count, 20);
        assert_eq!(run.best.as_ref().unwrap().surface_distance.seq, 2);
        let change = run.average_change_percent.as_ref().unwrap();
        assert_eq!(change.surface_distance.current.mean, Some(-50.0));
        // 1 and 2 of a diagonal of 2: half of the distances are not above half of it.
        let points = run.distribution.surface_distance.current.clone();
        let at_half = points.iter().find(|[percent, _]| 50.0 <= *percent);
        assert_eq!(at_half.unwrap()[1], 0.5);
    }

    #[test]
    fn the_last_ten_pairs_are_averaged_on_their_own_once_there_are_forty() {
        let of_first = |count: u64| {
            let pairs: Vec<(u64, bool)> = (1..=count).map(|seq| (seq, true)).collect();
            sequence(&pairs).targets[0].runs[0]
                .average_of_last_ten
                .clone()
        };
        assert!(of_first(39).is_none());
        let last = of_first(40).unwrap().distances.surface_distance.current;
        assert_eq!(last.own_unit.mean, 35.5);
    }

    #[test]
    fn without_a_registered_pair_everything_can_still_be_shown() {
        let sequence = sequence(&[(1, false)]);
        assert_eq!(sequence.targets[0].compared_pairs, 0);
        assert!(sequence.targets[0].runs[1].average.is_none());
        let evaluation = Evaluation::new(String::new(), vec![sequence]);
        for text in [
            super::super::terminal(&evaluation),
            super::super::report(&evaluation),
        ] {
            assert!(text.contains("failed registrations: 1"), "{text}");
            assert!(text.contains("a reason"), "{text}");
            assert!(text.contains("there is nothing to compare"), "{text}");
        }
        assert!(super::super::plots(&evaluation).is_ok());
    }
}
