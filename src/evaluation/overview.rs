//! What all of it comes to: one row a sequence and mode.

use super::results::{
    Averages, ByError, ConsistencySummary, Directions, Evaluation, Measure, Psnr, Run, Sequence,
    TargetEvaluation,
};
use super::tables::{Medium, four_digits, name, table};

/// Each mode's figures beside those of the original QEM: distances, sizes, and what comes back.
/// Of the last ten pairs too, where a sequence is long enough.
pub(super) fn overview(evaluation: &Evaluation, medium: Medium) -> String {
    let header = [
        "sequence",
        "algorithm",
        "k",
        "RMSE",
        "reverse",
        "RMSE",
        "(k-1)",
        "(k-1), samples",
        "vertex k",
        "vertex (k-1)",
        "vertices back",
        "edges back",
        "edges lost",
        "flicker",
        "Draco bytes",
    ];
    let mut table = table(&header, 2, medium);
    for_each_row(evaluation, |label, run, ours, original| {
        let distance = |measure, is_previous, is_rmse| {
            let of = |averages: &Averages| {
                let by_frame = averages.distances.get(measure);
                let summary = match is_previous {
                    true => by_frame.previous.as_ref()?,
                    false => &by_frame.current,
                };
                let percent = &summary.percent_of_diagonal;
                Some(if is_rmse { percent.rmse } else { percent.mean })
            };
            against(of(ours), original.and_then(of))
        };
        let mut row = vec![label, name(run.tracking).to_owned()];
        row.extend([
            distance(Measure::Surface, false, false),
            distance(Measure::Surface, false, true),
            distance(Measure::ToOutput, false, false),
            distance(Measure::ToOutput, false, true),
            distance(Measure::Surface, true, false),
            distance(Measure::Sample, true, false),
            distance(Measure::Vertex, false, false),
            distance(Measure::Vertex, true, false),
        ]);
        let before = original.map(|original| original.consistency.as_ref());
        row.extend(consistency_cells(ours.consistency.as_ref(), before));
        row.push(match original {
            None => format!("{:.0}", ours.bytes),
            Some(original) => change(ours.bytes, original.bytes),
        });
        table.add_row(row);
    });
    table.trim_fmt()
}

/// What comes back along the true motion; none if it is known nowhere.
pub(super) fn known_motion(evaluation: &Evaluation, medium: Medium) -> Option<String> {
    let header = [
        "sequence",
        "algorithm",
        "vertices back",
        "edges back",
        "edges lost",
        "flicker",
        "flicker along the registration",
    ];
    let mut table = table(&header, 2, medium);
    let mut is_known = false;
    for_each_row(evaluation, |label, run, ours, original| {
        let Some(known) = &ours.known_motion_consistency else {
            return;
        };
        is_known = true;
        let mut row = vec![label, name(run.tracking).to_owned()];
        let before = original.map(|original| original.known_motion_consistency.as_ref());
        row.extend(consistency_cells(Some(known), before));
        let flicker = |averages: &Averages| {
            let consistency = averages.consistency.as_ref();
            consistency.map(|c| c.flicker_percent_of_diagonal)
        };
        row.push(against(flicker(ours), original.and_then(flicker)));
        table.add_row(row);
    });
    is_known.then(|| table.trim_fmt())
}

/// D1 and D2 in both conventions, and the Hausdorff distance.
pub(super) fn coding_errors(target: &TargetEvaluation, medium: Medium) -> String {
    let header = [
        "algorithm",
        "D1, vertices",
        "better way",
        "D2, vertices",
        "better way",
        "D1, samples",
        "better way",
        "D2, samples",
        "better way",
        "Hausdorff %",
    ];
    let mut table = table(&header, 1, medium);
    for run in &target.runs {
        let Some(average) = &run.average else {
            continue;
        };
        let Psnr { vertices, samples } = &average.psnr;
        let mut row = vec![name(run.tracking).to_owned()];
        for ByError { d1, d2 } in [vertices, samples] {
            for Directions { worse, better } in [d1, d2] {
                row.extend([worse, better].map(|decibels| {
                    decibels.map_or_else(|| "-".to_owned(), |decibels| format!("{decibels:.2}"))
                }));
            }
        }
        row.push(four_digits(average.hausdorff_percent_of_diagonal));
        table.add_row(row);
    }
    table.trim_fmt()
}

/// By how many dB a PSNR is higher with MPEG's peak than with the diagonal; the mean of the pairs.
pub(super) fn mpeg_offset(sequence: &Sequence) -> f64 {
    let offsets = sequence
        .pairs
        .iter()
        .map(|pair| 20.0 * (pair.mpeg_peak / pair.bbox_diagonal).log10());
    offsets.sum::<f64>() / sequence.pairs.len().max(1) as f64
}

/// Calls `row` with the label, the run, its averages and, unless it is the original QEM itself,
/// the averages of that.
fn for_each_row(
    evaluation: &Evaluation,
    mut row: impl FnMut(String, &Run, &Averages, Option<&Averages>),
) {
    for sequence in &evaluation.sequences {
        for target in &sequence.targets {
            let label = format!("{}, {}", sequence.name, target.target);
            rows_of(target, &label, |run| run.average.as_ref(), &mut row);
            let label = format!("{label}, the last 10 pairs");
            rows_of(
                target,
                &label,
                |run| run.average_of_last_ten.as_ref(),
                &mut row,
            );
        }
    }
}

fn rows_of(
    target: &TargetEvaluation,
    label: &str,
    averages: fn(&Run) -> Option<&Averages>,
    row: &mut impl FnMut(String, &Run, &Averages, Option<&Averages>),
) {
    let original = target.runs.first().and_then(averages);
    for (index, run) in target.runs.iter().enumerate() {
        if let Some(ours) = averages(run) {
            let original = original.filter(|_| 0 < index);
            row(label.to_owned(), run, ours, original);
        }
    }
}

/// The shares that come back, how the share of the lost edges has changed, and the flicker.
fn consistency_cells(
    ours: Option<&ConsistencySummary>,
    original: Option<Option<&ConsistencySummary>>,
) -> [String; 4] {
    let Some(ours) = ours else {
        return std::array::from_fn(|_| "-".to_owned());
    };
    let original = original.flatten();
    let lost = |c: &ConsistencySummary| 1.0 - c.edge_persistence;
    let flicker = |c: &ConsistencySummary| c.flicker_percent_of_diagonal;
    [
        format!("{:.1} %", 100.0 * ours.vertex_persistence),
        format!("{:.1} %", 100.0 * ours.edge_persistence),
        match original {
            Some(original) if 0.0 < lost(original) => {
                format!("x {:.2}", lost(ours) / lost(original))
            }
            _ => format!("{:.1} %", 100.0 * lost(ours)),
        },
        against(Some(flicker(ours)), original.map(flicker)),
    ]
}

/// The figure itself, or its change if there is something to compare it with.
fn against(ours: Option<f64>, original: Option<f64>) -> String {
    match (ours, original) {
        (Some(ours), Some(original)) => change(ours, original),
        (Some(ours), None) => four_digits(ours),
        (None, _) => "-".to_owned(),
    }
}

fn change(ours: f64, original: f64) -> String {
    if original == 0.0 {
        return "-".to_owned();
    }
    format!("{:+.1} %", 100.0 * (ours / original - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_are_shown_by_their_change_and_the_original_by_itself() {
        let summary = |vertices, edges, flicker| ConsistencySummary {
            vertex_persistence: vertices,
            edge_persistence: edges,
            flicker_percent_of_diagonal: flicker,
        };
        let (off, robust) = (summary(0.125, 0.6, 0.02), summary(0.25, 0.7, 0.015));
        assert_eq!(
            consistency_cells(Some(&off), None),
            ["12.5 %", "60.0 %", "40.0 %", "0.02000"]
        );
        assert_eq!(
            consistency_cells(Some(&robust), Some(Some(&off))),
            ["25.0 %", "70.0 %", "x 0.75", "-25.0 %"]
        );
        assert_eq!(consistency_cells(None, None), ["-"; 4]);
    }
}
