//! One result of every mode, each face in the colour of its distance to a frame.

use super::path::Path;
use super::view::{View, Visibility};
use crate::evaluation::results::{ByFrame, TargetEvaluation};
use crate::evaluation::snapshots::Snapshot;
use crate::evaluation::tables::name;

/// The height of a panel, in picture units.
const PANEL_HEIGHT: i32 = 720;
const CAPTION: i32 = 80;
/// The least width of a panel: that of its caption.
const MIN_WIDTH: i32 = 390;
const GAP: i32 = 20;
/// Room at the right for the scale.
const SCALE_WIDTH: i32 = 156;
/// Colours that are told apart.
const BINS: usize = 12;
/// The distance at the end of the scale is not exceeded by this share of the vertices: few
/// outliers would leave one colour to all the others.
const SHARE_IN_SCALE: f64 = 0.985;
/// Where a scale may end, times a power of ten: the quarters are round.
const ENDS: [f64; 8] = [1.0, 1.2, 1.6, 2.0, 2.4, 4.0, 6.0, 8.0];
/// What the scale leads through, each as far from the next one.
const COLORS: [[f64; 3]; 4] = [
    [222.0, 235.0, 247.0],
    [253.0, 200.0, 80.0],
    [214.0, 40.0, 40.0],
    [60.0, 10.0, 50.0],
];

/// The picture: a column for each mode, the distances to the registered frame k-1 above those to
/// frame k.
pub(in crate::evaluation) fn heat_map(target: &TargetEvaluation) -> String {
    let pictured: Vec<(&Snapshot, &str)> = target
        .runs
        .iter()
        .filter_map(|run| {
            let middle = run.snapshots.get(run.snapshots.len() / 2)?;
            Some((middle, name(run.tracking)))
        })
        .collect();
    let meshes: Vec<_> = pictured
        .iter()
        .map(|(snapshot, _)| &snapshot.mesh)
        .collect();
    let view = View::of(&meshes, 1.0, PANEL_HEIGHT);
    let end = end_of_scale(&pictured);
    let panel_width = view.size[0].max(MIN_WIDTH);
    let width = GAP + pictured.len() as i32 * (panel_width + GAP) + SCALE_WIDTH;
    let height = 2 * (CAPTION + PANEL_HEIGHT);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{}\" height=\"{}\">\n\
         {}<rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n",
        width * 6 / 10,
        height * 6 / 10,
        style(),
    );
    for (column, (snapshot, mode)) in pictured.iter().enumerate() {
        let left = GAP + column as i32 * (panel_width + GAP);
        let ByFrame { previous, current } = &snapshot.distances;
        let rows = [(previous.as_ref(), "k-1"), (Some(current), "k")];
        for (row, (distances, frame)) in rows.into_iter().enumerate() {
            let Some(distances) = distances else { continue };
            let top = row as i32 * (CAPTION + PANEL_HEIGHT);
            svg.push_str(&caption(mode, frame, distances, [left, top]));
            let shown = panel(snapshot, distances, &view, end);
            let [w, h] = view.size;
            let (x, y) = (left + (panel_width - w) / 2, top + CAPTION);
            svg.push_str(&format!(
                "<svg x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\">\n{shown}</svg>\n"
            ));
        }
    }
    svg.push_str(&scale(end, width - SCALE_WIDTH));
    svg.push_str("</svg>\n");
    svg
}

/// A round number, the same for every panel, so that colours can be compared.
fn end_of_scale(pictured: &[(&Snapshot, &str)]) -> f64 {
    let mut all: Vec<f64> = pictured
        .iter()
        .flat_map(|(snapshot, _)| snapshot.distances.named().map(|(_, d)| d))
        .flatten()
        .copied()
        .collect();
    all.sort_unstable_by(f64::total_cmp);
    let place = (SHARE_IN_SCALE * all.len() as f64) as usize;
    let share = all.get(place).or(all.last()).copied().unwrap_or(0.0);
    if share <= 0.0 {
        return 1.0;
    }
    let power = 10f64.powf(share.log10().floor());
    let end = ENDS.into_iter().find(|end| share <= end * power);
    end.unwrap_or(10.0) * power
}

fn style() -> String {
    let mut style = String::from(
        "<style>text{font:28px sans-serif;fill:#222}.b{font-weight:bold}path{stroke-width:.8}\n",
    );
    for bin in 0..BINS {
        let color = color(bin);
        let hex = |shade: f64| -> String {
            let channels = color.map(|channel| format!("{:02x}", (channel * shade).round() as u8));
            channels.concat()
        };
        // The edges are a little darker, so that triangles are told apart.
        style.push_str(&format!(
            ".c{bin}{{fill:#{};stroke:#{}}}\n",
            hex(1.0),
            hex(0.88)
        ));
    }
    style + "</style>\n"
}

fn color(bin: usize) -> [f64; 3] {
    let at = bin as f64 / (BINS - 1) as f64 * (COLORS.len() - 1) as f64;
    let from = (at as usize).min(COLORS.len() - 2);
    let share = at - from as f64;
    std::array::from_fn(|channel| {
        COLORS[from][channel] * (1.0 - share) + COLORS[from + 1][channel] * share
    })
}

fn bin_of(distance: f64, end: f64) -> usize {
    ((distance / end * BINS as f64) as usize).min(BINS - 1)
}

fn caption(mode: &str, frame: &str, distances: &[f64], [left, top]: [i32; 2]) -> String {
    let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
    format!(
        "<text class=\"b\" x=\"{left}\" y=\"{}\">{mode}</text>\n\
         <text x=\"{left}\" y=\"{}\">to frame {frame}: mean {mean:.4} %</text>\n",
        top + 33,
        top + 69,
    )
}

/// The seen faces. Those that others cover in part are drawn first, from the back to the front;
/// the rest can be drawn in any order, one path a colour.
fn panel(snapshot: &Snapshot, distances: &[f64], view: &View, end: f64) -> String {
    let seen = view.look_at(&snapshot.mesh);
    let mut text = String::new();
    let mut wholly: Vec<Path> = vec![Path::default(); BINS];
    let face_of = |face: usize| {
        let corners = snapshot.mesh.faces()[face].map(|corner| corner as usize);
        let mean = corners.iter().map(|&corner| distances[corner]).sum::<f64>() / 3.0;
        (
            corners.map(|corner| seen.vertices[corner]),
            bin_of(mean, end),
        )
    };
    for &face in &seen.order {
        if seen.faces[face] == Visibility::Partly {
            let (corners, bin) = face_of(face);
            let mut path = Path::default();
            path.polyline(&corners);
            text.push_str(&path.element(&format!("c{bin}")));
        }
    }
    for (face, visibility) in seen.faces.iter().enumerate() {
        if *visibility == Visibility::Wholly {
            let (corners, bin) = face_of(face);
            wholly[bin].polyline(&corners);
        }
    }
    for (bin, path) in wholly.iter().enumerate() {
        text.push_str(&path.element(&format!("c{bin}")));
    }
    text
}

/// The colours and what they mean.
fn scale(end: f64, left: i32) -> String {
    const STEP: i32 = 48;
    let mut text = format!("<text x=\"{left}\" y=\"69\">distance, %</text>\n");
    for bin in 0..BINS {
        let top = CAPTION + STEP * (BINS - 1 - bin) as i32;
        let mut path = Path::default();
        path.polyline(&[
            [left, top],
            [left + 40, top],
            [left + 40, top + STEP],
            [left, top + STEP],
        ]);
        text.push_str(&path.element(&format!("c{bin}")));
        if bin % 3 == 0 {
            let value = end * bin as f64 / BINS as f64;
            let digits = format!("{value:.4}");
            let label = digits.trim_end_matches('0').trim_end_matches('.');
            text.push_str(&format!(
                "<text x=\"{}\" y=\"{}\">{label}</text>\n",
                left + 44,
                top + STEP + 9,
            ));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_goes_from_zero_to_a_round_distance_and_ends_there() {
        assert_eq!(bin_of(0.0, 0.5), 0);
        assert_eq!(bin_of(0.49, 0.5), BINS - 1);
        assert_eq!(bin_of(7.0, 0.5), BINS - 1);
        assert_eq!(color(0), COLORS[0]);
        assert_eq!(color(BINS - 1), COLORS[COLORS.len() - 1]);
    }
}
