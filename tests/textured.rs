//! Texture coordinates through the whole pipeline: seams stay closed, charts stay apart, and what
//! is delivered looks up the image where the original does.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and says what it measured"
)]

use std::path::PathBuf;

use steadymesh::pipeline::{
    AttributeWeight, Attributes, Output, PreparedFrame, Previous, ProcessedFrame, RawFrame,
    Settings, TargetSize, process,
};
use steadymesh_geometry::mesh::{Edge, EdgeTable};
use steadymesh_geometry::spatial::{TriangleTree, barycentric};
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_mesh_io::{Limits, Mesh, drc, obj};
use steadymesh_proto::metrics::Tracking;

const LIMITS: Limits = Limits {
    max_vertices: 1 << 20,
    max_faces: 1 << 20,
    max_memory_bytes: 1 << 30,
};
const FRAMES: [&str; 2] = [
    "basketball_player_00000001.obj",
    "basketball_player_00000002.obj",
];

/// With and without what holds seams in their places.
const WAYS: [(Tracking, bool); 4] = [
    (Tracking::Off, true),
    (Tracking::Robust, true),
    (Tracking::Off, false),
    (Tracking::Robust, false),
];

/// The textured captures, looked for as in `captures.rs`.
fn captures() -> Option<Vec<Mesh>> {
    let folder = std::env::var_os("STEADYMESH_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let folder = folder.join("textured");
    if !folder.is_dir() {
        println!("SKIPPED: no captures in {}", folder.display());
        return None;
    }
    let read = |name: &str| obj::read(&std::fs::read(folder.join(name)).unwrap(), &LIMITS).unwrap();
    Some(FRAMES.map(read).into())
}

/// Simplifies a sequence; gives what is delivered of its last frame, and that frame.
fn simplify(
    frames: &[Mesh],
    faces: usize,
    (tracking, has_image): (Tracking, bool),
) -> (PreparedFrame, ProcessedFrame) {
    let settings = Settings {
        target: TargetSize::Faces(faces),
        tracking,
        ..Settings::default()
    };
    let mut previous: Option<(PreparedFrame, ProcessedFrame)> = None;
    for mesh in frames {
        let raw = RawFrame {
            has_image,
            ..RawFrame::from_mesh(mesh.clone(), 0)
        };
        let frame = PreparedFrame::new(raw, &mut ()).unwrap();
        let before = previous.as_ref().map(|(frame, out)| Previous {
            frame,
            output: Some(&out.output),
        });
        let out = process(&frame, before, &settings, &mut ()).unwrap();
        previous = Some((frame, out));
    }
    previous.unwrap()
}

/// Positions and texture coordinates of every corner.
fn corners(mesh: &Mesh) -> Vec<([Point; 3], [[f64; 2]; 3])> {
    let mesh = mesh.with_attributes_per_vertex();
    let coordinates = &mesh.texture_coordinates.as_ref().unwrap().values;
    let corner = |face: &[u32; 3]| {
        let position = |index: u32| Point::from(mesh.positions[index as usize]);
        let coordinate = |index: u32| coordinates[index as usize].map(f64::from);
        (face.map(position), face.map(coordinate))
    };
    mesh.faces.iter().map(corner).collect()
}

fn blend(coordinates: &[[f64; 2]; 3], weights: [f64; 3]) -> [f64; 2] {
    [0, 1].map(|axis| (0..3).map(|i| weights[i] * coordinates[i][axis]).sum())
}

/// For the center of every face that is delivered, how far from each other the places in the image
/// are that it and the closest point of the original look up.
fn misplacements(original: &Mesh, delivered: &Mesh) -> Vec<f64> {
    let original = corners(original);
    let positions = original
        .iter()
        .flat_map(|(positions, _)| *positions)
        .collect();
    let faces = (0..original.len() as u32).map(|face| [0, 1, 2].map(|corner| 3 * face + corner));
    let surface = TriangleMesh::new(positions, faces.collect()).unwrap();
    let tree = TriangleTree::new(&surface).unwrap();
    let misplacement = |(triangle, coordinates): &([Point; 3], [[f64; 2]; 3])| {
        let center = Point::from(
            triangle
                .iter()
                .map(|p| p.coords)
                .sum::<nalgebra::Vector3<f64>>()
                / 3.0,
        );
        let foot = tree.closest(&center);
        let (positions, there) = &original[foot.face as usize];
        let [u, v] = blend(there, barycentric(&foot.position, positions));
        let [x, y] = blend(coordinates, [1.0 / 3.0; 3]);
        (u - x).hypot(v - y)
    };
    corners(delivered).iter().map(misplacement).collect()
}

/// The vertices on boundary edges.
fn boundary(mesh: &TriangleMesh) -> Vec<Point> {
    let table = EdgeTable::of(mesh.faces());
    let open = table.iter().filter(|(_, faces)| faces.len() == 1);
    let ends = open.flat_map(|(edge, _): (Edge, _)| [edge.0, edge.1]);
    ends.map(|vertex| mesh.positions()[vertex as usize])
        .collect()
}

#[test]
fn every_seam_is_closed_at_2000_faces() {
    let Some(frames) = captures() else { return };
    for (tracking, has_image) in WAYS {
        let (frame, out) = simplify(&frames, 2000, (tracking, has_image));
        let there = boundary(frame.mesh());
        let welded = Output::decode(&out.draco).unwrap().mesh;
        let open = boundary(&welded);
        println!(
            "{tracking:?} {has_image}: {} open ends of {}",
            open.len(),
            there.len()
        );
        assert!(out.metrics.output.vertices < out.metrics.output.points);
        assert_eq!(out.metrics.output.faces, 2000);
        assert!(open.len() <= there.len());
        // Where the original is open, and nowhere else.
        let near = 0.01 * frame.bounds().diagonal();
        for end in open {
            let distance = |other: &Point| (end - other).norm();
            let nearest = there.iter().map(distance).fold(f64::INFINITY, f64::min);
            assert!(
                nearest < near,
                "{tracking:?} {has_image}: {end} is {nearest} from a hole"
            );
        }
    }
}

#[test]
fn what_is_delivered_looks_up_the_image_where_the_original_does() {
    let Some(frames) = captures() else { return };
    for (tracking, has_image) in WAYS {
        let (_, out) = simplify(&frames, 4000, (tracking, has_image));
        let delivered = drc::read(&out.draco, &LIMITS).unwrap();
        let mut wrong = misplacements(&frames[1], &delivered);
        wrong.sort_by(f64::total_cmp);
        let share = |part: f64| wrong[(part * (wrong.len() - 1) as f64) as usize];
        let (median, most, all) = (share(0.5), share(0.99), share(1.0));
        let stray = wrong.iter().filter(|off| 0.02 < **off).count();
        println!(
            "{tracking:?} {has_image}: median {median:.5}, 99 % {most:.5}, largest {all:.5}, {stray} stray"
        );
        // In shares of the image: a chart that bleeds into another is off by tenths. Without an image
        // a face at a border may be half beyond it, where its chart goes on with its last texels.
        let (part, bound) = if has_image {
            (0.99, 0.02)
        } else {
            (0.95, 0.02)
        };
        assert!(median < 0.002, "{tracking:?}: {median}");
        assert!(
            share(part) < bound,
            "{tracking:?} {has_image}: {}",
            share(part)
        );
    }
}

/// A flat grid of `size` x `size` quads in two charts, of which the right one lies upside down in
/// the image.
fn two_charts(size: u32) -> RawFrame {
    let mut raw = RawFrame::default();
    let mut coordinates = Vec::new();
    for right in [false, true] {
        for row in 0..=size {
            for column in 0..=size / 2 {
                let x = f64::from(column) + if right { f64::from(size / 2) } else { 0.0 };
                // Not flat, so that it is not collapsed to two faces.
                let z = (x * 0.7).sin() * (f64::from(row) * 0.5).cos();
                raw.positions.push([x, f64::from(row), z]);
                let [u, v] = [column, row].map(|c| c as f32 / size as f32);
                coordinates.push(if right { [1.0 - u, 1.0 - v] } else { [u, v] });
            }
        }
        let width = size / 2 + 1;
        let first = if right { width * (size + 1) } else { 0 };
        for row in 0..size {
            for column in 0..size / 2 {
                let a = first + row * width + column;
                raw.faces.push([a, a + 1, a + width + 1]);
                raw.faces.push([a, a + width + 1, a + width]);
            }
        }
    }
    raw.repeated_points = size as usize + 1;
    raw.has_image = true;
    raw.attributes = Attributes {
        colors: Some(
            coordinates
                .iter()
                .map(|[u, v]| [(u * 255.0) as u8, (v * 255.0) as u8, 7, 255])
                .collect(),
        ),
        texture_coordinates: Some(coordinates),
        ..Attributes::default()
    };
    raw
}

#[test]
fn charts_do_not_bleed_into_each_other() {
    for has_image in [true, false] {
        charts_do_not_bleed(has_image);
    }
}

fn charts_do_not_bleed(has_image: bool) {
    let raw = RawFrame {
        has_image,
        ..two_charts(40)
    };
    let frame = PreparedFrame::new(raw, &mut ()).unwrap();
    let settings = Settings {
        target: TargetSize::Faces(300),
        tracking: Tracking::Off,
        ..Settings::default()
    };
    let out = process(&frame, None, &settings, &mut ()).unwrap();
    let mesh = drc::read(&out.draco, &LIMITS).unwrap();
    for (triangle, coordinates) in corners(&mesh) {
        // A seam is held in its place, not nailed to it; beyond it a chart goes on with its last
        // texels.
        let of_left = |p: &Point| [p.x.min(20.0) / 40.0, p.y / 40.0];
        let of_right = |p: &Point| [1.0 - (p.x - 20.0).max(0.0) / 40.0, 1.0 - p.y / 40.0];
        let off = |chart: &dyn Fn(&Point) -> [f64; 2]| {
            let corners = triangle.iter().zip(coordinates);
            let off = corners.map(|(p, [u, v])| (u - chart(p)[0]).hypot(v - chart(p)[1]));
            off.fold(0.0, f64::max)
        };
        let (left, right) = (off(&of_left), off(&of_right));
        assert!(left.min(right) < 0.02, "{triangle:?}: {coordinates:?}");
    }
    // Seen as one surface the seam is closed: only the rim is open.
    let welded = Output::decode(&out.draco).unwrap().mesh;
    for end in boundary(&welded) {
        let is_rim = |c: f64| !(0.2..=39.8).contains(&c);
        assert!(is_rim(end.x) || is_rim(end.y), "{end} is open");
    }
}

#[test]
fn without_an_image_texture_coordinates_change_nothing_of_the_shape() {
    let Some(frames) = captures() else { return };
    let bare = frames.iter().cloned().map(|mesh| Mesh {
        texture_coordinates: None,
        ..mesh
    });
    let bare: Vec<Mesh> = bare.collect();
    let (_, plain) = simplify(&bare, 4000, (Tracking::Robust, false));
    let (_, out) = simplify(&frames, 4000, (Tracking::Robust, false));
    let figures = |out: &ProcessedFrame| {
        let metrics = &out.metrics;
        let distance = metrics.surface_distance.clone().unwrap().current.mean;
        (
            metrics.output.vertices,
            distance,
            metrics.consistency.unwrap(),
        )
    };
    let ((vertices, distance, kept), (plain_vertices, plain_distance, plain_kept)) =
        (figures(&out), figures(&plain));
    println!("{distance} {kept:?}, without coordinates {plain_distance} {plain_kept:?}");
    // Draco may round two vertices to the same place.
    assert!(vertices.abs_diff(plain_vertices) < 4);
    assert!((distance / plain_distance - 1.0).abs() < 0.01);
    assert!((kept.vertex_persistence - plain_kept.vertex_persistence).abs() < 0.01);
}

#[test]
fn colors_come_from_the_original_surface() {
    let frame = PreparedFrame::new(two_charts(40), &mut ()).unwrap();
    let settings = Settings {
        target: TargetSize::Faces(300),
        ..Settings::default()
    };
    let out = process(&frame, None, &settings, &mut ()).unwrap();
    let mesh = drc::read(&out.draco, &LIMITS).unwrap();
    let colors = mesh.colors.unwrap().values;
    let coordinates = mesh.texture_coordinates.unwrap().values;
    assert_eq!(colors.len(), mesh.positions.len());
    for ([red, green, blue, alpha], [u, v]) in colors.iter().zip(coordinates) {
        assert_eq!((*blue, *alpha), (7, 255));
        let off = [(red, u), (green, v)].map(|(c, t)| (f32::from(*c) - t * 255.0).abs());
        assert!(off.iter().all(|off| *off < 6.0), "{off:?}");
    }
}

/// A slightly bumpy sheet with a dark disc painted on it, a color for every vertex.
fn painted_sheet(size: u32) -> RawFrame {
    let positions = (0..size * size).map(|at| {
        let (x, y) = (f64::from(at % size), f64::from(at / size));
        [x, y, 0.4 * (0.31 * x).sin() * (0.27 * y).cos()]
    });
    let positions: Vec<[f64; 3]> = positions.collect();
    let faces = (0..(size - 1) * (size - 1)).flat_map(|cell| {
        let a = cell / (size - 1) * size + cell % (size - 1);
        [[a, a + 1, a + size + 1], [a, a + size + 1, a + size]]
    });
    let colors = positions.iter().map(|&at| painted(at, f64::from(size)));
    RawFrame {
        attributes: Attributes {
            colors: Some(colors.collect()),
            ..Attributes::default()
        },
        faces: faces.collect(),
        positions,
        ..RawFrame::default()
    }
}

fn painted([x, y, _]: [f64; 3], size: f64) -> [u8; 4] {
    let from_rim = (x - size / 2.0).hypot(y - size / 2.0) - size / 4.0;
    let value = (128.0 + 64.0 * from_rim).clamp(20.0, 230.0) as u8;
    [value, value, 90, 255]
}

#[test]
fn colors_with_a_weight_stay_where_they_are() {
    const SIZE: u32 = 60;
    let original = painted_sheet(SIZE);
    let error_with = |tracking, weight| {
        let settings = Settings {
            target: TargetSize::Faces(400),
            tracking,
            attribute_weight: AttributeWeight::new(weight).unwrap(),
            ..Settings::default()
        };
        let frame = PreparedFrame::new(original.clone(), &mut ()).unwrap();
        let out = process(&frame, None, &settings, &mut ()).unwrap();
        let mesh = drc::read(&out.draco, &LIMITS).unwrap();
        let colors = mesh.colors.as_ref().unwrap().values.clone();
        let positions = mesh.positions.iter().map(|&p| Point::from(p)).collect();
        let delivered = TriangleMesh::new(positions, mesh.faces.clone()).unwrap();
        let surface = TriangleTree::new(&delivered).unwrap();
        let errors = original.positions.iter().map(|&at| {
            let below = surface.closest(&Point::from(at));
            let corners = mesh.faces[below.face as usize].map(|corner| corner as usize);
            let weights = barycentric(&below.position, &delivered.triangle(below.face as usize));
            let shown = corners.iter().zip(weights);
            let shown: f64 = shown.map(|(c, w)| w * f64::from(colors[*c][0])).sum();
            (shown - f64::from(painted(at, f64::from(SIZE))[0])).powi(2)
        });
        (errors.sum::<f64>() / original.positions.len() as f64).sqrt()
    };
    for tracking in [Tracking::Off, Tracking::Robust, Tracking::Paper] {
        let (without, with) = (error_with(tracking, 0.0), error_with(tracking, 0.02));
        println!("{tracking:?}: off by {without} without, {with} with a weight");
        assert!(with < 0.6 * without, "{tracking:?}: {without} {with}");
    }
}

/// A sheet whose left half has another material than the right one; the border zigzags.
fn two_materials(size: u32) -> Mesh {
    let positions = (0..size * size).map(|at| {
        let (x, y) = (f64::from(at % size), f64::from(at / size));
        [x, y, 0.4 * (0.31 * x).sin() * (0.27 * y).cos()]
    });
    let cells = (0..(size - 1) * (size - 1)).map(|cell| (cell % (size - 1), cell / (size - 1)));
    let faces = cells.clone().flat_map(|(x, y)| {
        let a = y * size + x;
        [[a, a + 1, a + size + 1], [a, a + size + 1, a + size]]
    });
    let of_cell = |(x, y): (u32, u32)| u32::from(size / 2 + y / 4 % 3 <= x);
    let materials = cells.flat_map(|cell| [[of_cell(cell); 3]; 2]);
    Mesh {
        positions: positions.collect(),
        faces: faces.collect(),
        materials: Some(steadymesh_mesh_io::Attribute {
            values: vec![3, 9],
            faces: Some(materials.collect()),
        }),
        ..Mesh::default()
    }
}

/// The places where faces of different materials meet.
fn border(mesh: &Mesh) -> Vec<Point> {
    let mut places: Vec<([u64; 3], u16)> = Vec::new();
    for (index, face) in mesh.faces.iter().enumerate() {
        let material = mesh.material_of(index).unwrap();
        let at = |corner: &u32| mesh.positions[*corner as usize].map(f64::to_bits);
        places.extend(face.iter().map(|corner| (at(corner), material)));
    }
    places.sort_unstable();
    places.dedup();
    let pairs = places.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    pairs
        .map(|pair| Point::from(pair[0].0.map(f64::from_bits)))
        .collect()
}

#[test]
fn faces_keep_their_material_and_its_border_stays() {
    const SIZE: u32 = 48;
    let original = two_materials(SIZE);
    for (tracking, faces) in [(Tracking::Off, 300), (Tracking::Robust, 300)] {
        let frames = [original.clone(), original.clone()];
        let (_, out) = simplify(&frames, faces, (tracking, false));
        assert!(out.metrics.output.target_reached);
        let mesh = drc::read(&out.draco, &LIMITS).unwrap();
        let area = |mesh: &Mesh, number: u16| -> f64 {
            let own = (0..mesh.faces.len()).filter(|&face| mesh.material_of(face) == Some(number));
            own.map(|face| {
                let [a, b, c] = mesh.faces[face].map(|corner| mesh.positions[corner as usize]);
                ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs() / 2.0
            })
            .sum()
        };
        for number in [3, 9] {
            let (before, after) = (area(&original, number), area(&mesh, number));
            assert!(
                (after / before - 1.0).abs() < 0.02,
                "{tracking:?} {before} {after}"
            );
        }
        for face in &mesh.faces {
            let materials = mesh.materials.as_ref().unwrap();
            let [a, b, c] = face.map(|corner| materials.values[corner as usize]);
            assert!(a == b && b == c, "a face of two materials");
        }
        let strays = border(&mesh).into_iter().map(|at| {
            let places = border(&original);
            let distances = places.iter().map(|place| (place - at).norm());
            distances.fold(f64::INFINITY, f64::min)
        });
        let stray = strays.fold(0.0, f64::max);
        println!("{tracking:?}: the border strays by {stray}");
        assert!(stray < 0.6, "{tracking:?}: {stray}");
        // The points at the border are apart, the surface is not.
        // The points at the border are apart, the surface is not.
        let welded: Vec<Point> = mesh.positions.iter().map(|&p| Point::from(p)).collect();
        let (mut places, mut numbers) = (Vec::<Point>::new(), Vec::new());
        for point in welded {
            let known = places.iter().position(|place| *place == point);
            numbers.push(known.unwrap_or(places.len()) as u32);
            if known.is_none() {
                places.push(point);
            }
        }
        let faces = mesh
            .faces
            .iter()
            .map(|face| face.map(|c| numbers[c as usize]));
        let welded = TriangleMesh::new(places, faces.collect()).unwrap();
        for end in boundary(&welded) {
            let is_rim = |c: f64| !(0.2..=f64::from(SIZE) - 1.2).contains(&c);
            assert!(is_rim(end.x) || is_rim(end.y), "{end} is open");
        }
    }
}
