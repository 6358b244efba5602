//! What people read: the tables on a terminal, and the report.

use super::plots::{DISTRIBUTIONS, distribution_file, over_frames_file, title};
use super::published;
use super::results::{Evaluation, Measure, TargetEvaluation};
use super::tables::{self, Medium};

/// The tables, for a terminal of fixed-width characters.
#[must_use]
pub fn terminal(evaluation: &Evaluation) -> String {
    let mut text = summary(evaluation);
    text.push('\n');
    for pair in &evaluation.pairs {
        if let Some(error) = &pair.registration_error {
            text.push_str(&format!("Frame {}: {error}.\n", pair.seq));
        }
    }
    push(&mut text, UNITS);
    for target in &evaluation.targets {
        push(&mut text, &format!("To {} faces", target.target_faces));
        push(&mut text, &tables::sizes(target, Medium::Terminal));
        if target.compared_pairs == 0 {
            push(&mut text, NOTHING_TO_COMPARE);
            continue;
        }
        for (title, table) in distance_tables(target, Medium::Terminal) {
            push(&mut text, &title);
            text.push_str(&table);
            text.push('\n');
        }
    }
    text
}

/// The report in Markdown. It refers to the files of [`plots`](super::plots()) by their names.
#[must_use]
pub fn report(evaluation: &Evaluation) -> String {
    let mut text = String::from("# Evaluation of Tracked QEM\n");
    let (version, command) = (&evaluation.version, &evaluation.command);
    push(&mut text, &format!("Made by Steadymesh {version} with"));
    push(&mut text, &format!("```sh\n{command}\n```"));
    push(&mut text, &summary(evaluation));
    push(&mut text, "## What is measured");
    push(&mut text, METHOD);
    push(&mut text, UNITS);
    push(&mut text, "## Registration");
    push(&mut text, REGISTRATION);
    push(
        &mut text,
        &tables::registrations(evaluation, Medium::Markdown),
    );
    for target in &evaluation.targets {
        push_target(&mut text, evaluation, target);
    }
    text
}

const NOTHING_TO_COMPARE: &str =
    "No previous frame could be registered, so there is nothing to compare.";

const UNITS: &str = "\
Ave, STD, RMSE and max are in the mesh's own unit, Var and MSE in its square; \"Ave %\" and
\"RMSE %\" are in percent of the diagonal of the frame's bounding box. Frames are counted from 0.";

const METHOD: &str = "\
Frame k-1 is registered onto frame k once for each pair. Frame k is simplified by the original
QEM and with tracking, compressed with Draco, and what players then see is measured against
the registered frame k-1 and against frame k, as in section 4.1 of the Tracked QEM paper: from
each vertex of the result to the closest point of the surface (mesh surface distance) and to the
closest vertex (nearest vertex distance).

*Best* is, for each algorithm on its own, the pair with the smallest sum of the mean distances
to the two frames. *Average* is the mean over the pairs; STD and RMSE are the roots of the mean
Var and MSE, as the numbers in the paper are. The paper does not state its unit, and its MSE
is not the mean of squares (it is smaller than the square of its average): compare its changes
in percent, and its MSE and RMSE with nothing.

Averages over the result's vertices become smaller when vertices are removed from bad places,
without any surface moving. The same distance from samples spread evenly over the result, and
the distance in the other direction, cannot be improved like that.";

const REGISTRATION: &str = "\
Distances from the vertices of the registered frame k-1 to the surface of frame k, in percent of
the diagonal.";

fn summary(evaluation: &Evaluation) -> String {
    let (frames, pairs) = (evaluation.frames.len(), evaluation.pairs.len());
    let registered = evaluation.pairs.iter().filter_map(|pair| {
        let registration = pair.registration.as_ref()?;
        Some(100.0 * registration.residual.mean / pair.bbox_diagonal)
    });
    let (mut count, mut sum) = (0, 0.0);
    for residual in registered {
        count += 1;
        sum += residual;
    }
    let failed = pairs - count;
    let text = format!("{frames} frames, {pairs} pairs, failed registrations: {failed}");
    if count == 0 {
        return format!("{text}.");
    }
    let residual = sum / count as f64;
    format!("{text}, mean registration residual {residual:.4} % of the diagonal.")
}

fn push_target(text: &mut String, evaluation: &Evaluation, target: &TargetEvaluation) {
    push(text, &format!("## To {} faces", target.target_faces));
    push(text, &tables::sizes(target, Medium::Markdown));
    if target.compared_pairs == 0 {
        push(text, NOTHING_TO_COMPARE);
        return;
    }
    for (title, table) in distance_tables(target, Medium::Markdown) {
        push(text, &format!("### {title}"));
        push(text, &table);
    }
    for measure in Measure::ALL {
        push(text, &format!("### {} over the frames", title(measure)));
        push(
            text,
            &image(title(measure), &over_frames_file(target, measure)),
        );
        push(text, "Means in percent of the diagonal:");
        push(
            text,
            &tables::pairs(evaluation, target, measure, Medium::Markdown),
        );
        if DISTRIBUTIONS.contains(&measure) {
            let alternative = format!("{}: distribution", title(measure));
            push(
                text,
                &image(&alternative, &distribution_file(target, measure)),
            );
        }
    }
}

/// The paper's four tables and the two that it does not have. A report has the paper's own
/// figures in them, a terminal has no room for them.
fn distance_tables(target: &TargetEvaluation, medium: Medium) -> Vec<(String, String)> {
    let mut tables = Vec::new();
    for published in &published::TABLES {
        let what = (published.measure, published.is_best);
        let shown = (medium == Medium::Markdown).then_some(published);
        let table = tables::distances(target, what, shown, medium);
        tables.push((published.title.to_owned(), table));
    }
    let others = [
        (
            Measure::Sample,
            "average surface distance from 20,000 even samples of the result",
        ),
        (
            Measure::ToOutput,
            "average distance from the frames' vertices to the result",
        ),
    ];
    for (measure, title) in others {
        let table = tables::distances(target, (measure, false), None, medium);
        tables.push((format!("Not in the paper: {title}"), table));
    }
    tables
}

fn image(alternative: &str, file_name: &str) -> String {
    format!("![{alternative}]({file_name})")
}

/// Adds a paragraph.
fn push(text: &mut String, paragraph: &str) {
    text.push('\n');
    text.push_str(paragraph);
    text.push('\n');
}
