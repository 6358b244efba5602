//! From the figures of pairs to those of a sequence.

use steadymesh_proto::metrics::{Consistency, Statistics};

use super::results::{
    Averages, Best, ByError, ByFrame, ByMeasure, Change, ConsistencySummary, Directions, Measure,
    Output, Psnr, Summary,
};

/// The figures of one pair's result.
#[derive(Clone, Copy)]
pub(super) struct PairFigures<'a> {
    /// The diagonal of the bounding box of frame k.
    pub diagonal: f64,
    /// All of them.
    pub output: &'a Output,
    /// The distances among them.
    pub distances: &'a ByMeasure<ByFrame<Statistics>>,
}

/// The averages over `pairs`; none if there are none.
pub(super) fn averages(pairs: &[PairFigures<'_>]) -> Option<Averages> {
    let over = |of: &dyn Fn(&PairFigures<'_>) -> Option<f64>| mean(pairs.iter().filter_map(of));
    let psnr = |of: fn(&Psnr) -> &ByError| {
        let decibels = |of_error: fn(&ByError) -> &Directions| Directions {
            worse: over(&|p| of_error(of(p.output.psnr.as_ref()?)).worse),
            better: over(&|p| of_error(of(p.output.psnr.as_ref()?)).better),
        };
        ByError {
            d1: decibels(|error| &error.d1),
            d2: decibels(|error| &error.d2),
        }
    };
    Some(Averages {
        distances: average(pairs)?,
        hausdorff_percent_of_diagonal: over(&|p| Some(100.0 * p.output.hausdorff? / p.diagonal))?,
        psnr: Psnr {
            vertices: psnr(|psnr| &psnr.vertices),
            samples: psnr(|psnr| &psnr.samples),
        },
        consistency: average_consistency(pairs, |output| output.consistency.as_ref()),
        known_motion_consistency: average_consistency(pairs, |output| {
            output.known_motion_consistency.as_ref()
        }),
        bytes: over(&|p| Some(p.output.bytes as f64))?,
        mbit_per_second: over(&|p| Some(p.output.mbit_per_second))?,
    })
}

fn average_consistency(
    pairs: &[PairFigures<'_>],
    of: fn(&Output) -> Option<&Consistency>,
) -> Option<ConsistencySummary> {
    let found: Vec<(&Consistency, f64)> = pairs
        .iter()
        .filter_map(|pair| Some((of(pair.output)?, pair.diagonal)))
        .collect();
    Some(ConsistencySummary {
        vertex_persistence: mean(found.iter().map(|(c, _)| c.vertex_persistence))?,
        edge_persistence: mean(found.iter().map(|(c, _)| c.edge_persistence))?,
        flicker_percent_of_diagonal: mean(found.iter().map(|(c, d)| 100.0 * c.flicker / d))?,
    })
}

/// The mean of `values`; none if there are none.
fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), v| (sum + v, count + 1));
    (0 < count).then(|| sum / f64::from(count))
}

fn average(pairs: &[PairFigures<'_>]) -> Option<ByMeasure<ByFrame<Summary>>> {
    let each = |measure: Measure| {
        pairs
            .iter()
            .map(move |pair| summaries(pair, measure))
            .collect::<Vec<_>>()
    };
    (!pairs.is_empty()).then(|| {
        ByMeasure::from_fn(|measure| {
            let of_pairs = each(measure);
            let previous: Option<Vec<_>> = of_pairs.iter().map(|s| s.previous.as_ref()).collect();
            let current: Vec<_> = of_pairs.iter().map(|s| &s.current).collect();
            ByFrame {
                previous: previous.map(|previous| average_summary(&previous)),
                current: average_summary(&current),
            }
        })
    })
}

/// The best of `pairs` for each kind of distance; none if there are none.
pub(super) fn best(pairs: &[PairFigures<'_>]) -> Option<ByMeasure<Best>> {
    let first = pairs.first()?;
    Some(ByMeasure::from_fn(|measure| {
        let mut best = (first.output.seq, summaries(first, measure));
        for pair in &pairs[1..] {
            let summary = summaries(pair, measure);
            if badness(&summary) < badness(&best.1) {
                best = (pair.output.seq, summary);
            }
        }
        let (seq, summary) = best;
        Best { seq, summary }
    }))
}

/// By how many percent `figures` are above `original`.
pub(super) fn change(figures: &ByFrame<Summary>, original: &ByFrame<Summary>) -> ByFrame<Change> {
    let of = |a: &Summary, b: &Summary| change_of_statistics(&a.own_unit, &b.own_unit);
    let previous = figures.previous.as_ref().zip(original.previous.as_ref());
    ByFrame {
        previous: previous.map(|(a, b)| of(a, b)),
        current: of(&figures.current, &original.current),
    }
}

/// Both distances count alike, and the size of the frames does not matter.
fn badness(summary: &ByFrame<Summary>) -> f64 {
    summary
        .named()
        .map(|(_, summary)| summary.percent_of_diagonal.mean)
        .sum()
}

fn summaries(pair: &PairFigures<'_>, measure: Measure) -> ByFrame<Summary> {
    let percent = 100.0 / pair.diagonal;
    pair.distances.get(measure).map(|statistics| Summary {
        own_unit: statistics.clone(),
        percent_of_diagonal: scaled(statistics, percent),
    })
}

/// The statistics of the same distances, each multiplied by `factor`.
fn scaled(statistics: &Statistics, factor: f64) -> Statistics {
    Statistics {
        mean: statistics.mean * factor,
        variance: statistics.variance * factor * factor,
        std: statistics.std * factor,
        mse: statistics.mse * factor * factor,
        rmse: statistics.rmse * factor,
        max: statistics.max * factor,
        count: statistics.count,
    }
}

fn average_summary(summaries: &[&Summary]) -> Summary {
    Summary {
        own_unit: average_statistics(summaries, |s| &s.own_unit),
        percent_of_diagonal: average_statistics(summaries, |s| &s.percent_of_diagonal),
    }
}

/// The means of the means; the maximum is that of all, and the count the sum.
fn average_statistics(summaries: &[&Summary], unit: fn(&Summary) -> &Statistics) -> Statistics {
    let mean = |of: fn(&Statistics) -> f64| {
        summaries.iter().map(|s| of(unit(s))).sum::<f64>() / summaries.len() as f64
    };
    let (variance, mse) = (mean(|s| s.variance), mean(|s| s.mse));
    Statistics {
        mean: mean(|s| s.mean),
        variance,
        // The paper's Tables 3 and 4: STD² is Var, and RMSE² is MSE.
        std: variance.sqrt(),
        mse,
        rmse: mse.sqrt(),
        max: summaries.iter().map(|s| unit(s).max).fold(0.0, f64::max),
        count: summaries.iter().map(|s| unit(s).count).sum(),
    }
}

fn change_of_statistics(figures: &Statistics, original: &Statistics) -> Change {
    let percent = |of: fn(&Statistics) -> f64| {
        let before = of(original);
        (before != 0.0).then(|| 100.0 * (of(figures) / before - 1.0))
    };
    Change {
        mean: percent(|s| s.mean),
        variance: percent(|s| s.variance),
        std: percent(|s| s.std),
        mse: percent(|s| s.mse),
        rmse: percent(|s| s.rmse),
        max: percent(|s| s.max),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::statistics;

    fn output(seq: u64, previous: &[f64], current: &[f64]) -> Output {
        Output {
            seq,
            bytes: 1000,
            hausdorff: Some(1.0),
            distances: Some(ByMeasure::from_fn(|_| ByFrame {
                previous: Some(statistics(previous)),
                current: statistics(current),
            })),
            ..Output::default()
        }
    }

    fn pair(diagonal: f64, output: &Output) -> PairFigures<'_> {
        PairFigures {
            diagonal,
            output,
            distances: output.distances.as_ref().unwrap(),
        }
    }

    #[test]
    fn averages_are_means_of_means_and_roots_of_mean_squares() {
        let (a, b) = (
            output(1, &[1.0, 3.0], &[2.0]),
            output(2, &[6.0, 10.0], &[4.0]),
        );
        let average = average(&[pair(10.0, &a), pair(20.0, &b)]).unwrap();
        let previous = average.surface_distance.previous.unwrap();
        assert_eq!(previous.own_unit.mean, 5.0);
        assert_eq!(previous.own_unit.variance, f64::midpoint(1.0, 4.0));
        assert_eq!(previous.own_unit.std, 2.5_f64.sqrt());
        assert_eq!(previous.own_unit.mse, f64::midpoint(5.0, 68.0));
        assert_eq!(previous.own_unit.rmse, 36.5_f64.sqrt());
        assert_eq!((previous.own_unit.max, previous.own_unit.count), (10.0, 4));
        // 20 % of the one diagonal and 40 % of the other.
        assert!((previous.percent_of_diagonal.mean - 30.0).abs() < 1e-12);
        assert_eq!(average.surface_distance.current.own_unit.mean, 3.0);
    }

    #[test]
    fn the_best_pair_has_the_smallest_sum_relative_to_its_size() {
        let (small, large) = (output(1, &[1.0], &[2.0]), output(2, &[3.0], &[2.0]));
        let pairs = [pair(10.0, &small), pair(100.0, &large)];
        let best = best(&pairs).unwrap();
        assert_eq!(best.surface_distance.seq, 2);
        assert_eq!(best.surface_distance.summary.current.own_unit.mean, 2.0);
    }

    #[test]
    fn half_of_the_distance_is_a_change_of_minus_fifty_percent() {
        let (tracked, original) = (output(1, &[1.0], &[3.0]), output(1, &[2.0], &[0.0]));
        let average = |o| average(&[pair(1.0, o)]).unwrap().surface_distance;
        let change = change(&average(&tracked), &average(&original));
        let previous = change.previous.unwrap();
        assert_eq!((previous.mean, previous.mse), (Some(-50.0), Some(-75.0)));
        assert_eq!(change.current.mean, None);
    }

    #[test]
    fn there_is_no_average_of_no_pairs() {
        assert!(averages(&[]).is_none() && best(&[]).is_none());
    }

    #[test]
    fn decibels_and_shares_are_averaged_over_the_pairs_that_have_them() {
        let decibels = |worse| Directions {
            worse,
            better: Some(90.0),
        };
        let with = |worse, flicker| {
            let mut output = output(1, &[1.0], &[1.0]);
            let mut psnr = Psnr::default();
            psnr.vertices.d2 = decibels(worse);
            output.psnr = Some(psnr);
            output.consistency = Some(Consistency {
                vertex_persistence: 0.5,
                edge_persistence: 0.75,
                flicker,
            });
            output
        };
        // Where there is no error there are no decibels.
        let outputs = [
            with(Some(60.0), 1.0),
            with(Some(70.0), 4.0),
            with(None, 1.0),
        ];
        let pairs = [
            pair(10.0, &outputs[0]),
            pair(20.0, &outputs[1]),
            pair(10.0, &outputs[2]),
        ];
        let averages = averages(&pairs).unwrap();
        assert_eq!(
            averages.psnr.vertices.d2,
            Directions {
                worse: Some(65.0),
                better: Some(90.0)
            }
        );
        assert_eq!(averages.psnr.samples, ByError::default());
        let consistency = averages.consistency.unwrap();
        assert!((consistency.flicker_percent_of_diagonal - 40.0 / 3.0).abs() < 1e-12);
        assert_eq!(consistency.vertex_persistence, 0.5);
        assert_eq!(averages.known_motion_consistency, None);
        assert!((averages.hausdorff_percent_of_diagonal - 25.0 / 3.0).abs() < 1e-12);
    }
}
