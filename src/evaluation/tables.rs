//! Figures as aligned rows: for the terminal and, with other borders, for Markdown.

use comfy_table::{CellAlignment, Table, presets};
use steadymesh_proto::metrics::{Statistics, Tracking};

use super::published::{Indicators, PublishedTable};
use super::results::{ByFrame, Change, Measure, Output, Run, Sequence, Summary, TargetEvaluation};

/// Where a table is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Medium {
    /// A terminal: no borders but the lines that part the rows.
    Terminal,
    /// A Markdown file.
    Markdown,
}

/// What people call an algorithm.
pub(super) fn name(tracking: Tracking) -> &'static str {
    match tracking {
        Tracking::Off => "original",
        Tracking::Paper => "tracked (paper)",
        Tracking::Robust => "tracked (robust)",
    }
}

/// The distances of a target's runs: for each of the two frames one row a run and one row for
/// its change. "Ave %" and "RMSE %" are in percent of the diagonal. With the paper's figures if
/// `published` has any.
pub(super) fn distances(
    target: &TargetEvaluation,
    (measure, is_best): (Measure, bool),
    published: Option<&PublishedTable>,
    medium: Medium,
) -> String {
    let header = [
        "mesh",
        "algorithm",
        "Ave",
        "Var",
        "STD",
        "MSE",
        "RMSE",
        "max",
        "Ave %",
        "RMSE %",
    ];
    let mut table = table(&header, 2, medium);
    for (is_previous, mesh) in [(true, "(k-1)-th"), (false, "k-th")] {
        for run in &target.runs {
            let Some(found) = found(run, measure, is_best) else {
                continue;
            };
            let algorithm = match found.best_seq {
                Some(seq) => format!("{}, frame {seq}", name(run.tracking)),
                None => name(run.tracking).to_owned(),
            };
            if let Some(summary) = side(found.summary, is_previous) {
                table.add_row(summary_row(mesh, algorithm, summary));
            }
            if let Some(change) = found.change.and_then(|change| side(change, is_previous)) {
                table.add_row(change_row(mesh, change));
            }
        }
        let published = published.and_then(|published| {
            let original = side(&published.original, is_previous)?;
            Some((original, side(&published.tracked, is_previous)?))
        });
        if let Some((original, tracked)) = published {
            table.add_rows(published_rows(mesh, original, tracked));
        }
    }
    table.trim_fmt()
}

/// What went out: faces, bytes, bit rate.
pub(super) fn sizes(target: &TargetEvaluation, medium: Medium) -> String {
    let header = [
        "algorithm",
        "faces",
        "target reached",
        "Draco bytes",
        "Mbit/s at 30 fps",
        "non-manifold edges",
    ];
    let mut table = table(&header, 1, medium);
    for run in &target.runs {
        let outputs = &run.outputs;
        let faces = || outputs.iter().map(|o| o.faces);
        let (fewest, most) = (faces().min().unwrap_or(0), faces().max().unwrap_or(0));
        let reached = outputs.iter().filter(|o| o.target_reached).count();
        let non_manifold: usize = outputs.iter().map(|o| o.non_manifold_edges).sum();
        table.add_row([
            name(run.tracking).to_owned(),
            if fewest == most {
                fewest.to_string()
            } else {
                format!("{fewest} to {most}")
            },
            format!("{reached} of {}", outputs.len()),
            format!("{:.0}", mean(outputs, |o| o.bytes as f64)),
            format!("{:.3}", mean(outputs, |o| o.mbit_per_second)),
            non_manifold.to_string(),
        ]);
    }
    table.trim_fmt()
}

/// How well each pair was registered.
pub(super) fn registrations(sequence: &Sequence, medium: Medium) -> String {
    let header = [
        "frame k", "file", "faces", "diagonal", "mean", "RMS", "95 %", "max", "nodes", "rounds",
    ];
    let mut table = table(&header, 2, medium);
    for pair in &sequence.pairs {
        let file = sequence.frames.get(pair.seq as usize);
        let mut row = vec![
            pair.seq.to_string(),
            file.cloned().unwrap_or_default(),
            pair.faces.to_string(),
            four_digits(pair.bbox_diagonal),
        ];
        let registration = pair.registration.as_ref();
        if let Some(registration) = registration.filter(|_| pair.reset.is_none()) {
            let residual = &registration.residual;
            let percent = |d: f64| four_digits(100.0 * d / pair.bbox_diagonal);
            row.extend([residual.mean, residual.rms, residual.p95, residual.max].map(percent));
            row.push(registration.nodes.to_string());
            row.push(registration.iterations.to_string());
        } else {
            row.extend(
                pair.registration_error
                    .as_ref()
                    .or(pair.reset.as_ref())
                    .cloned(),
            );
        }
        table.add_row(row);
    }
    table.trim_fmt()
}

/// What there is to show of a run in one table.
struct Found<'a> {
    best_seq: Option<u64>,
    summary: &'a ByFrame<Summary>,
    change: Option<&'a ByFrame<Change>>,
}

fn found(run: &Run, measure: Measure, is_best: bool) -> Option<Found<'_>> {
    Some(if is_best {
        let best = run.best.as_ref()?.get(measure);
        Found {
            best_seq: Some(best.seq),
            summary: &best.summary,
            change: run.best_change_percent.as_ref().map(|c| c.get(measure)),
        }
    } else {
        Found {
            best_seq: None,
            summary: run.average.as_ref()?.distances.get(measure),
            change: run.average_change_percent.as_ref().map(|c| c.get(measure)),
        }
    })
}

fn side<T>(by_frame: &ByFrame<T>, is_previous: bool) -> Option<&T> {
    if is_previous {
        by_frame.previous.as_ref()
    } else {
        Some(&by_frame.current)
    }
}

fn summary_row(mesh: &str, algorithm: String, summary: &Summary) -> Vec<String> {
    let Statistics {
        mean,
        variance,
        std,
        mse,
        rmse,
        max,
        ..
    } = summary.own_unit;
    let percent = &summary.percent_of_diagonal;
    let figures = [mean, variance, std, mse, rmse, max];
    let mut row = vec![mesh.to_owned(), algorithm];
    row.extend(figures.map(four_digits));
    row.extend([percent.mean, percent.rmse].map(four_digits));
    row
}

fn change_row(mesh: &str, change: &Change) -> Vec<String> {
    let Change {
        mean,
        variance,
        std,
        mse,
        rmse,
        max,
    } = *change;
    let mut row = vec![mesh.to_owned(), "change".to_owned()];
    row.extend(
        [mean, variance, std, mse, rmse, max].map(|change| {
            change.map_or_else(|| "-".to_owned(), |percent| format!("{percent:+.1} %"))
        }),
    );
    row
}

fn published_rows(mesh: &str, original: &Indicators, tracked: &Indicators) -> Vec<Vec<String>> {
    let row = |label: &str, figures: [String; 5]| {
        let mut row = vec![mesh.to_owned(), label.to_owned()];
        row.extend(figures);
        row
    };
    let printed = |[mean, variance, std, mse, rmse]: Indicators| {
        let [mean, std, mse, rmse] = [mean, std, mse, rmse].map(four_digits);
        [mean, format!("{variance:.0}"), std, mse, rmse]
    };
    let mut change = original.map(|_| String::new());
    for (text, (before, after)) in change.iter_mut().zip(original.iter().zip(tracked)) {
        *text = format!("{:+.1} %", 100.0 * (after / before - 1.0));
    }
    vec![
        row("the paper's original", printed(*original)),
        row("the paper's tracked", printed(*tracked)),
        row("the paper's change", change),
    ]
}

/// An empty table whose first `text_columns` are text, and the others numbers.
pub(super) fn table<T: ToString>(header: &[T], text_columns: usize, medium: Medium) -> Table {
    let mut table = Table::new();
    table.load_style(match medium {
        Medium::Terminal => presets::NOTHING,
        Medium::Markdown => presets::ASCII_MARKDOWN,
    });
    table.set_header(header.iter().map(ToString::to_string));
    for column in table.column_iter_mut().skip(text_columns) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

fn mean(outputs: &[Output], of: fn(&Output) -> f64) -> f64 {
    outputs.iter().map(of).sum::<f64>() / outputs.len().max(1) as f64
}

/// `value` with four valid digits, as in the paper's tables.
pub(super) fn four_digits(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let magnitude = value.abs().log10().floor();
    if (-4.0..6.0).contains(&magnitude) {
        let decimals = (3.0 - magnitude).max(0.0) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.3e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_four_valid_digits_whatever_the_unit() {
        let shown = [0.0, 0.012_345, 7.547, 178.2, 55731.4, 1.5e-7, 2e9].map(four_digits);
        assert_eq!(
            shown,
            [
                "0", "0.01235", "7.547", "178.2", "55731", "1.500e-7", "2.000e9"
            ]
        );
    }

    #[test]
    fn the_papers_own_change_is_that_of_its_abstract_findings() {
        let table = &super::super::published::TABLES[2];
        let [_, _, change] = &published_rows(
            "(k-1)-th",
            &table.original.previous.unwrap(),
            &table.tracked.previous.unwrap(),
        )[..] else {
            panic!("three rows")
        };
        assert_eq!(change[2..4], ["-36.6 %", "-77.0 %"]);
    }
}
