//! What people read: the tables on a terminal, and the report.

use super::overview::{coding_errors, known_motion, mpeg_offset, overview};
use super::plots::{DISTRIBUTIONS, Image, has_pictures};
use super::published;
use super::results::{Evaluation, Measure, Sequence, TargetEvaluation};
use super::tables::{self, Medium};

/// The tables, for a terminal of fixed-width characters.
#[must_use]
pub fn terminal(evaluation: &Evaluation) -> String {
    let mut text = UNITS.to_owned();
    text.push('\n');
    for sequence in &evaluation.sequences {
        push(&mut text, &sequence.name);
        push(&mut text, &summary(sequence));
        for pair in &sequence.pairs {
            if let Some(reason) = pair.registration_error.as_ref().or(pair.reset.as_ref()) {
                text.push_str(&format!("Frame {}: {reason}.\n", pair.seq));
            }
        }
        for target in &sequence.targets {
            push(&mut text, &format!("To {}", target.target));
            push(&mut text, &tables::sizes(target, Medium::Terminal));
            if target.compared_pairs == 0 {
                push(&mut text, NOTHING_TO_COMPARE);
                continue;
            }
            push(&mut text, &coding_errors(target, Medium::Terminal));
            for (title, table) in distance_tables(target, Medium::Terminal) {
                push(&mut text, &title);
                text.push_str(&table);
                text.push('\n');
            }
        }
    }
    push_overview(&mut text, evaluation, Medium::Terminal);
    text
}

/// The report in Markdown. It refers to the files of [`plots`](super::plots()) by their names.
#[must_use]
pub fn report(evaluation: &Evaluation) -> String {
    let mut text = String::from("# Evaluation of Tracked QEM\n");
    let (version, command) = (&evaluation.version, &evaluation.command);
    push(&mut text, &format!("Made by Steadymesh {version} with"));
    push(&mut text, &format!("```sh\n{command}\n```"));
    push(&mut text, "## Overview");
    push_overview(&mut text, evaluation, Medium::Markdown);
    push(&mut text, "## What is measured");
    push(&mut text, METHOD);
    push(&mut text, UNITS);
    for sequence in &evaluation.sequences {
        push(&mut text, &format!("## {}", sequence.name));
        push(&mut text, &summary(sequence));
        push_folded(
            &mut text,
            "Registration: distances from the vertices of the registered frame k-1 to the surface \
             of frame k, in percent of the diagonal",
            &tables::registrations(sequence, Medium::Markdown),
        );
        for target in &sequence.targets {
            push_target(&mut text, sequence, target);
        }
    }
    text
}

const NOTHING_TO_COMPARE: &str =
    "No previous frame could be registered, so there is nothing to compare.";

const UNITS: &str = "\
Ave, STD, RMSE and max are in the mesh's own unit, Var and MSE in its square; \"Ave %\" and
\"RMSE %\" are in percent of the diagonal of the frame's bounding box. Frames are counted from 0.";

const OVERVIEW: &str = "\
The original QEM's figures, in percent of the diagonal, and how the others differ. *k* is the
distance from the result's vertices to frame k, *reverse* that from frame k's vertices to the
result, *(k-1)* that to the registered frame k-1 (from even samples of the result's surface too),
*vertex* that to the nearest vertex. *Vertices back* is the share of the result's vertices within
a tenth of its mean edge of a vertex of the result before it, carried along; *edges back* the share
of that one's edges that are there again, *edges lost* the rest (as a factor of the original's);
*flicker* the mean distance of the two surfaces.";

const KNOWN_MOTION: &str = "\
Along the true motion, which the synthetic rig knows, instead of the registration's:";

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
the distance in the other direction, cannot be improved like that.

D1 and D2 are the point-to-point and point-to-plane errors of point-cloud coding (Tian et al.,
ICIP 2017, <https://doi.org/10.1109/ICIP.2017.8296925>) between the result and frame k, as PSNR in
dB, the mean over the pairs: on the vertices of both, and on 100,000 even samples of each surface.
Each is given for the direction with the larger error, as MPEG states it, and for the better one,
as some papers do. The peak is the diagonal of frame k's bounding box. MPEG's software takes √3
times the side of the cube of voxels, which is more for all that is not a cube; by how much, if the
voxels just hold the frame, stands with each table. D1 on samples is bounded by the distance from
one sample to the next. The Hausdorff distance is the largest of all
from the vertices of either mesh, or the samples of the result, to the other's surface.

The pictures are of the first size: five frames from the middle of the sequence as wireframes, with
what was there in the frame before in blue, and the middle one with each face in the colour of the
mean distance of its corners. Consistency is along the true motion in them where that is known.";

fn push_overview(text: &mut String, evaluation: &Evaluation, medium: Medium) {
    push(text, OVERVIEW);
    push(text, &overview(evaluation, medium));
    if let Some(table) = known_motion(evaluation, medium) {
        push(text, KNOWN_MOTION);
        push(text, &table);
    }
}

fn summary(sequence: &Sequence) -> String {
    let (frames, pairs) = (sequence.frames.len(), sequence.pairs.len());
    let registered = sequence.pairs.iter().filter_map(|pair| {
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

fn push_target(text: &mut String, sequence: &Sequence, target: &TargetEvaluation) {
    let image = |image: Image| image_link(image, sequence, target);
    push(
        text,
        &format!("### {}: to {}", sequence.name, target.target),
    );
    if has_pictures(target) {
        push(text, &image(Image::ContactSheet));
        push(text, &image(Image::HeatMap));
    }
    push(text, &tables::sizes(target, Medium::Markdown));
    if target.compared_pairs == 0 {
        push(text, NOTHING_TO_COMPARE);
        return;
    }
    let offset = mpeg_offset(sequence);
    push(
        text,
        &format!("PSNR in dB; with MPEG's peak each is {offset:.2} dB higher:"),
    );
    push(text, &coding_errors(target, Medium::Markdown));
    for (title, table) in distance_tables(target, Medium::Markdown) {
        push(text, &format!("#### {title}"));
        push(text, &table);
    }
    push(text, "#### Over the frames");
    push(text, &image(Image::Persistence));
    for measure in Measure::ALL {
        push(text, &image(Image::OverFrames(measure)));
        if DISTRIBUTIONS.contains(&measure) {
            push(text, &image(Image::Distribution(measure)));
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

fn image_link(image: Image, sequence: &Sequence, target: &TargetEvaluation) -> String {
    let alternative = format!("{}: {}", sequence.name, image.title(target.target));
    format!("![{alternative}]({})", image.file(sequence, target))
}

/// Adds a paragraph.
fn push(text: &mut String, paragraph: &str) {
    text.push('\n');
    text.push_str(paragraph);
    text.push('\n');
}

/// Adds what few will want to read, behind its title.
fn push_folded(text: &mut String, title: &str, paragraph: &str) {
    push(text, &format!("<details><summary>{title}</summary>"));
    push(text, paragraph);
    push(text, "</details>");
}
