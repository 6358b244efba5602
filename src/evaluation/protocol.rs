//! The experiment, pair by pair.

use steadymesh_geometry::TriangleMesh;
use steadymesh_geometry::mesh::EdgeTable;
use steadymesh_proto::metrics::{Consistency, Statistics, Tracking};
use steadymesh_proto::stream::MetricsMode;

use crate::pipeline::{
    PreparedFrame, ProcessFailed, ProcessedFrame, Settings, TargetSize, process,
    process_registered, register, statistics,
};

use super::aggregate::{PairFigures, average, best, change};
use super::distribution::Distribution;
use super::measure::{Reference, measure};
use super::results::{
    ByFrame, ByMeasure, Evaluation, FRAMES_PER_SECOND, FramePair, Measure, Output, Run,
    TargetEvaluation,
};

/// What is to be compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Numbers of faces, each of them usable ([`TargetSize::check`]).
    pub target_faces: Vec<usize>,
    /// The tracking modes to be compared with the original QEM, which is always there.
    pub modes: Vec<Tracking>,
    /// How frames are registered and encoded.
    pub settings: Settings,
}

/// An evaluation under way. It holds figures, and of meshes only each run's last result.
#[derive(Debug)]
pub struct Protocol {
    settings: Settings,
    pairs: Vec<FramePair>,
    targets: Vec<TargetUnderWay>,
}

#[derive(Debug)]
struct TargetUnderWay {
    target_faces: usize,
    runs: Vec<RunUnderWay>,
}

#[derive(Debug)]
struct RunUnderWay {
    tracking: Tracking,
    outputs: Vec<Output>,
    distribution: ByMeasure<ByFrame<Distribution>>,
    /// The number of the last frame that was simplified, and what became of it.
    last: Option<(u64, TriangleMesh)>,
}

/// One simplified frame and its raw distances.
struct Measured {
    output: Output,
    distances: Option<ByMeasure<ByFrame<Vec<f64>>>>,
}

impl Protocol {
    /// Starts without any pair.
    #[must_use]
    pub fn new(plan: Plan) -> Self {
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
            last: None,
        };
        let target = |target_faces| TargetUnderWay {
            target_faces,
            runs: modes.iter().map(run).collect(),
        };
        Self {
            settings: plan.settings,
            pairs: Vec::new(),
            targets: plan.target_faces.into_iter().map(target).collect(),
        }
    }

    /// Adds frame `seq` and its predecessor. Returns the predecessor as it was registered: the
    /// mesh that was measured against, none if the registration failed.
    ///
    /// # Errors
    ///
    /// [`ProcessFailed`] if Draco refuses its part.
    pub fn add_pair(
        &mut self,
        seq: u64,
        previous: &PreparedFrame,
        current: &PreparedFrame,
    ) -> Result<Option<TriangleMesh>, ProcessFailed> {
        let (registered, registration_error) =
            match register(previous, current, &self.settings.registration) {
                Ok(registered) => (Some(registered), None),
                Err(error) => (None, Some(error.to_string())),
            };
        let references = references(current.mesh(), registered.as_ref().map(|r| &r.mesh));
        let diagonal = current.bounds().diagonal();
        for target in &mut self.targets {
            let mut measured = Vec::with_capacity(target.runs.len());
            for run in &mut target.runs {
                let settings = Settings {
                    target: TargetSize::Faces(target.target_faces),
                    tracking: run.tracking,
                    // Measured here, against trees that are built once for all runs.
                    metrics: MetricsMode::Off,
                    ..self.settings.clone()
                };
                let before = match run.last.take() {
                    Some((last, mesh)) if last + 1 == seq => mesh,
                    // A first frame is the original QEM in every mode.
                    _ => process(previous, None, &settings, &mut ())?.mesh,
                };
                let (registered, carry) = (registered.clone(), Some(&before));
                let carried = registered.as_ref().map(|r| r.carry(&before));
                let out = process_registered(current, registered, carry, &settings, &mut ())?;
                let distances = references.as_ref().and_then(|r| measure(&out.mesh, r));
                let mut output = output(seq, &out, distances.as_ref());
                output.consistency = carried.and_then(|carried| carried.consistency(&out.mesh));
                measured.push(Measured { output, distances });
                run.last = Some((seq, out.mesh));
            }
            target.add(measured, diagonal);
        }
        self.pairs.push(FramePair {
            seq,
            faces: current.mesh().face_count(),
            bbox_diagonal: diagonal,
            registration: registered.as_ref().map(|r| r.figures.clone()),
            registration_error,
        });
        Ok(registered.map(|registered| registered.mesh))
    }

    /// Sums up. `command` is what the user typed, and `frames` the names of the files.
    #[must_use]
    pub fn finish(self, command: String, frames: Vec<String>) -> Evaluation {
        let targets = self.targets.into_iter();
        Evaluation {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            command,
            frames,
            targets: targets.map(|target| target.finish(&self.pairs)).collect(),
            pairs: self.pairs,
        }
    }
}

impl TargetUnderWay {
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
            target_faces: self.target_faces,
            compared_pairs: compared.iter().filter(|&&compared| compared).count(),
            runs,
        }
    }
}

impl RunUnderWay {
    fn add_distances(&mut self, distances: &ByMeasure<ByFrame<Vec<f64>>>, diagonal: f64) {
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
                    seq: pair.seq,
                    diagonal: pair.bbox_diagonal,
                    distances: output.distances.as_ref()?,
                })
            })
            .collect();
        let (average, best) = (average(&figures), best(&figures));
        let averages = average
            .as_ref()
            .zip(original.and_then(|o| o.average.as_ref()));
        let average_change_percent = averages
            .map(|(ours, original)| ByMeasure::from_fn(|m| change(ours.get(m), original.get(m))));
        let bests = best.as_ref().zip(original.and_then(|o| o.best.as_ref()));
        let best_change_percent = bests.map(|(ours, original)| {
            ByMeasure::from_fn(|m| change(&ours.get(m).summary, &original.get(m).summary))
        });
        let distribution = &self.distribution;
        Run {
            tracking: self.tracking,
            consistency: mean_consistency(&self.outputs, compared),
            average_change_percent,
            best_change_percent,
            distribution: ByMeasure::from_fn(|m| distribution.get(m).map(Distribution::cumulative)),
            average,
            best,
            outputs: self.outputs,
        }
    }
}

/// The mean over the `compared` pairs; none if there are none.
fn mean_consistency(outputs: &[Output], compared: &[bool]) -> Option<Consistency> {
    let compared = outputs
        .iter()
        .zip(compared)
        .filter(|(_, compared)| **compared);
    let found: Vec<Consistency> = compared
        .filter_map(|(output, _)| output.consistency)
        .collect();
    let mean = |of: fn(&Consistency) -> f64| found.iter().map(of).sum::<f64>() / found.len() as f64;
    (!found.is_empty()).then(|| Consistency {
        vertex_persistence: mean(|c| c.vertex_persistence),
        edge_persistence: mean(|c| c.edge_persistence),
        flicker: mean(|c| c.flicker),
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

fn output(
    seq: u64,
    out: &ProcessedFrame,
    distances: Option<&ByMeasure<ByFrame<Vec<f64>>>>,
) -> Output {
    let figures = &out.metrics.output;
    let summed_up = |distances: &ByMeasure<ByFrame<Vec<f64>>>| -> ByMeasure<ByFrame<Statistics>> {
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
        non_manifold_edges: EdgeTable::of(out.mesh.faces()).non_manifold_count(),
        distances: distances.map(summed_up),
        consistency: None,
    }
}

/// Whether there is something to compare: distances to both frames.
fn is_compared(output: &Output) -> bool {
    let distances = output.distances.as_ref();
    distances.is_some_and(|d| d.surface_distance.previous.is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame_pair(seq: u64, is_registered: bool) -> FramePair {
        FramePair {
            seq,
            faces: 1000,
            bbox_diagonal: 2.0,
            registration: is_registered.then(Default::default),
            registration_error: (!is_registered).then(|| "a reason".to_owned()),
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
                tracking: Tracking::Off,
                vertices: 10,
                faces: 16,
                target_reached: true,
                bytes: 100,
                mbit_per_second: 0.024,
                non_manifold_edges: 0,
                distances: Some(ByMeasure::from_fn(sums)),
                consistency: None,
            },
            distances: Some(distances),
        }
    }

    fn evaluation(pairs: &[(u64, bool)]) -> Evaluation {
        let plan = Plan {
            target_faces: vec![16],
            modes: vec![Tracking::Paper, Tracking::Off, Tracking::Paper],
            settings: Settings::default(),
        };
        let mut protocol = Protocol::new(plan);
        for &(seq, is_registered) in pairs {
            let distance = seq as f64;
            let runs = [distance, distance / 2.0].map(|d| measured(seq, is_registered, d));
            protocol.targets[0].add(runs.into(), 2.0);
            protocol.pairs.push(frame_pair(seq, is_registered));
        }
        protocol.finish(String::new(), Vec::new())
    }

    #[test]
    fn the_original_comes_first_and_every_mode_once() {
        let modes: Vec<Tracking> = evaluation(&[]).targets[0]
            .runs
            .iter()
            .map(|run| run.tracking)
            .collect();
        assert_eq!(modes, [Tracking::Off, Tracking::Paper]);
    }

    #[test]
    fn a_pair_that_was_not_registered_is_listed_but_not_compared() {
        let evaluation = evaluation(&[(1, false), (2, true), (4, true)]);
        let target = &evaluation.targets[0];
        assert_eq!(target.compared_pairs, 2);
        let run = &target.runs[1];
        assert_eq!(run.outputs.len(), 3);
        let average = run.average.as_ref().unwrap().surface_distance.clone();
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
    fn without_a_registered_pair_everything_can_still_be_shown() {
        let evaluation = evaluation(&[(1, false)]);
        assert_eq!(evaluation.targets[0].compared_pairs, 0);
        assert!(evaluation.targets[0].runs[1].average.is_none());
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
