//! Consecutive wireframes of every mode, with what was there before in another colour.

use steadymesh_geometry::mesh::Edge;

use super::path::{Path, chains};
use super::view::{Seen, View, Visibility};
use crate::evaluation::results::{Run, TargetEvaluation};
use crate::evaluation::snapshots::Snapshot;
use crate::evaluation::tables::name;

/// The share of the figure's height that is shown, from the top: so that triangles are seen.
const SHOWN: f64 = 0.3;
/// The height of a panel, in picture units.
const PANEL_HEIGHT: i32 = 460;
/// The least width of a panel: that of its caption.
const MIN_WIDTH: i32 = 405;
/// Room above a panel for its caption, and above all for the legend.
const CAPTION: i32 = 80;
const LEGEND: i32 = 52;
const GAP: i32 = 20;

/// What was there in the frame before is blue, from the palette of Okabe and Ito; the rest orange.
const STYLE: &str = "\
<style>text{font:23px sans-serif;fill:#222}.b{font-weight:bold}
path{fill:none;stroke-linecap:round;stroke-linejoin:round}
.n{stroke:#e69f00;stroke-width:1.6}.k{stroke:#0072b2;stroke-width:1.6}
.w{stroke:#d55e00;stroke-width:6.5}.v{stroke:#00395c;stroke-width:8}</style>
";

/// The sheet: a row for each mode, a column for each frame.
pub(in crate::evaluation) fn contact_sheet(target: &TargetEvaluation) -> String {
    let snapshots = || target.runs.iter().flat_map(|run| &run.snapshots);
    let meshes: Vec<_> = snapshots().map(|snapshot| &snapshot.mesh).collect();
    let view = View::of(&meshes, SHOWN, PANEL_HEIGHT);
    let columns = target.runs.iter().map(|run| run.snapshots.len()).max();
    let panel_width = view.size[0].max(MIN_WIDTH);
    let width = columns.unwrap_or(0) as i32 * (panel_width + GAP) + GAP;
    let height = LEGEND + target.runs.len() as i32 * (CAPTION + PANEL_HEIGHT);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{}\" height=\"{}\">\n\
         {STYLE}<rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n",
        width * 6 / 10,
        height * 6 / 10,
    );
    svg.push_str(&legend());
    for (row, run) in target.runs.iter().enumerate() {
        let top = LEGEND + row as i32 * (CAPTION + PANEL_HEIGHT);
        for (column, snapshot) in run.snapshots.iter().enumerate() {
            let left = GAP + column as i32 * (panel_width + GAP);
            svg.push_str(&caption(run, snapshot, column == 0, [left, top]));
            let indent = (panel_width - view.size[0]) / 2;
            svg.push_str(&panel(snapshot, &view, [left + indent, top + CAPTION]));
        }
    }
    svg.push_str("</svg>\n");
    svg
}

fn legend() -> String {
    let entries = [
        ("v", "vertex that was there in the frame before"),
        ("w", "new vertex"),
        ("k", "edge that was there"),
        ("n", "new edge"),
    ];
    let mut text = String::new();
    let mut x = GAP;
    for (class, label) in entries {
        let end = if "vw".contains(class) { x } else { x + 42 };
        let mut sample = Path::default();
        sample.polyline(&[[x, 28], [end, 28]]);
        text.push_str(&sample.element(class));
        text.push_str(&format!(
            "<text x=\"{}\" y=\"36\">{label}</text>\n",
            end + 16
        ));
        x = end + 64 + 11 * label.len() as i32;
    }
    text
}

/// What the panel shows, and the shares of the whole mesh that were there before.
fn caption(run: &Run, snapshot: &Snapshot, is_first: bool, [left, top]: [i32; 2]) -> String {
    let mut text = String::new();
    if is_first {
        text = format!(
            "<text class=\"b\" x=\"{left}\" y=\"{}\">{}</text>\n",
            top + 28,
            name(run.tracking)
        );
    }
    let mut label = format!("frame {}", snapshot.seq);
    if let Some(persistence) = &snapshot.persistence {
        let vertices = persistence.vertices.iter().filter(|back| **back).count();
        let share = 100.0 * vertices as f64 / persistence.vertices.len().max(1) as f64;
        let edges = 100.0 * persistence.found_edge_share;
        label.push_str(&format!(
            ": {share:.0} % of vertices, {edges:.0} % of edges"
        ));
    }
    text.push_str(&format!(
        "<text x=\"{left}\" y=\"{}\">{label}</text>\n",
        top + 58
    ));
    text
}

fn panel(snapshot: &Snapshot, view: &View, [left, top]: [i32; 2]) -> String {
    let seen = view.look_at(&snapshot.mesh);
    let [width, height] = view.size;
    let (kept, new): (Vec<_>, Vec<_>) = visible_edges(snapshot, &seen)
        .into_iter()
        .partition(|(_, was_there)| *was_there);
    let mut is_seen = vec![false; seen.vertices.len()];
    let mut lines = |edges: &[(Edge, bool)]| {
        let edges: Vec<[u32; 2]> = edges.iter().map(|(edge, _)| [edge.0, edge.1]).collect();
        let mut path = Path::default();
        for chain in chains(&edges) {
            let mut points = Vec::with_capacity(chain.len());
            for vertex in chain {
                is_seen[vertex as usize] = true;
                points.push(seen.vertices[vertex as usize]);
            }
            path.polyline(&points);
        }
        path
    };
    let (new, kept) = (lines(&new), lines(&kept));
    let (mut was_there, mut is_new) = (Path::default(), Path::default());
    if let Some(persistence) = &snapshot.persistence {
        for (vertex, persists) in persistence.vertices.iter().enumerate() {
            if is_seen[vertex] {
                let dots = if *persists {
                    &mut was_there
                } else {
                    &mut is_new
                };
                dots.dot(seen.vertices[vertex]);
            }
        }
    }
    format!(
        "<svg x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\">\n{}{}{}{}</svg>\n",
        new.element("n"),
        kept.element("k"),
        is_new.element("w"),
        was_there.element("v"),
    )
}

/// The edges of seen faces, each once, and whether it was there before.
fn visible_edges(snapshot: &Snapshot, seen: &Seen) -> Vec<(Edge, bool)> {
    let mut edges: Vec<Edge> = snapshot
        .mesh
        .faces()
        .iter()
        .zip(&seen.faces)
        .filter(|(_, visibility)| **visibility != Visibility::Hidden)
        .flat_map(|(face, _)| Edge::of_face(*face))
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let was_there = |edge: Edge| {
        let known = snapshot.persistence.as_ref()?;
        let place = known
            .edges
            .binary_search_by_key(&edge, |(edge, _)| *edge)
            .ok()?;
        Some(known.edges[place].1)
    };
    let with_past = |edge| (edge, was_there(edge).unwrap_or(false));
    edges.into_iter().map(with_past).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::results::ByFrame;
    use steadymesh_geometry::metrics::persistence;
    use steadymesh_geometry::{Point, TriangleMesh};

    #[test]
    fn edges_and_vertices_that_were_not_there_are_drawn_as_new() {
        let corners = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]].map(Point::from);
        let with = |faces: Vec<[u32; 3]>, moved: f64| {
            let mut positions = corners.to_vec();
            positions[0].x -= moved;
            TriangleMesh::new(positions, faces).unwrap()
        };
        let before = with(vec![[0, 1, 2], [0, 2, 3]], 0.0);
        let mesh = with(vec![[0, 1, 3], [1, 2, 3]], 0.4);
        let snapshot = Snapshot {
            seq: 1,
            persistence: persistence(&before, &mesh),
            distances: ByFrame::default(),
            mesh,
        };
        let view = View::of(&[&snapshot.mesh], 1.0, 200);
        let drawn = panel(&snapshot, &view, [0, 0]);
        let data_of = |class: &str| {
            let (_, rest) = drawn
                .split_once(&format!("class=\"{class}\" d=\""))
                .unwrap();
            rest.split('"').next().unwrap()
        };
        // One line of two points; four edges in one line; one vertex moved, three did not.
        let numbers = |class: &str| data_of(class).matches(|c: char| " -m".contains(c)).count();
        assert_eq!((numbers("n"), numbers("k")), (4, 10));
        assert_eq!(data_of("w").matches("h0").count(), 1);
        assert_eq!(data_of("v").matches("h0").count(), 3);
    }
}
