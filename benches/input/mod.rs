//! What the benches run on: two frames of a sequence, and every stage on them.

use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;

use steadymesh::pipeline::{
    self, Output, PreparedFrame, Previous, RawFrame, Settings, TargetSize, add_distances,
};
use steadymesh_draco::{DecodeLimits, EncodeOptions, MeshView};
use steadymesh_geometry::mesh::repair::repair;
use steadymesh_geometry::metrics::consistency_with_surface;
use steadymesh_geometry::registration::{self, Carried, Target};
use steadymesh_geometry::simplification::{Anchors, Options, anchors, simplify, simplify_anchored};
use steadymesh_geometry::spatial::{TriangleTree, closest_to_vertices};
use steadymesh_geometry::{Point, TriangleMesh};
use steadymesh_mesh_io::{Format, Limits, Mesh, glb, obj, ply, read};
use steadymesh_proto::FrameMetrics;
use steadymesh_proto::stream::MetricsMode;
use steadymesh_synthetic_rig::{Options as RigOptions, Rig};

const LIMITS: Limits = Limits {
    max_vertices: 1 << 22,
    max_faces: 1 << 22,
    max_memory_bytes: 1 << 32,
};

/// Two frames of a sequence as they were captured.
pub struct Sequence {
    /// What the figures are filed under.
    #[allow(dead_code, reason = "instructions are counted on the rig alone")]
    pub name: String,
    previous: Mesh,
    current: Mesh,
}

impl Sequence {
    /// The tenth and eleventh frame of the synthetic rig, which has twice as many faces as vertices.
    pub fn of_rig(face_count: usize) -> Self {
        let options = RigOptions {
            vertex_count: face_count / 2,
            ..RigOptions::default()
        };
        let rig = Rig::new(&options).expect("the sizes are in the rig's range");
        let frame = |index| {
            let frame = rig.frame(index);
            Mesh {
                positions: frame.positions.iter().map(|p| p.map(f64::from)).collect(),
                faces: frame.faces,
                normals: None,
                colors: None,
                materials: None,
                texture_coordinates: None,
                image: None,
            }
        };
        Self {
            name: face_count.to_string(),
            previous: frame(10),
            current: frame(11),
        }
    }

    /// The first two frames in a folder of captures; none if it does not have them.
    #[allow(dead_code, reason = "instructions are counted on the rig alone")]
    pub fn of_captures(folder: &Path) -> Option<Self> {
        let mut paths: Vec<_> = std::fs::read_dir(folder)
            .ok()?
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| format_of(path).is_some())
            .collect();
        paths.sort();
        let frame = |path: &Path| {
            let bytes = std::fs::read(path).ok()?;
            read(&bytes, format_of(path)?, &LIMITS).ok()
        };
        Some(Self {
            name: folder.file_name()?.to_str()?.to_owned(),
            previous: frame(paths.first()?)?,
            current: frame(paths.get(1)?)?,
        })
    }

    /// Faces of the second frame.
    #[allow(dead_code, reason = "instructions are counted on the rig alone")]
    pub fn face_count(&self) -> usize {
        self.current.faces.len()
    }
}

fn format_of(path: &Path) -> Option<Format> {
    Format::from_extension(path.extension()?.to_str()?)
}

/// A stage's name, and what makes one run of it ready: what is derived from a mesh is computed once and
/// kept with it, so that a run gets meshes that nobody has looked at.
pub type Stage<'a> = (&'static str, Box<dyn Fn() -> Run<'a> + 'a>);

/// One run, to be measured.
pub type Run<'a> = Box<dyn FnOnce() + 'a>;

/// The stages of one frame that need no frame before it.
pub struct Alone {
    files: [(&'static str, Format, Vec<u8>); 4],
    raw: RawFrame,
    received: TriangleMesh,
    repaired: TriangleMesh,
    simplified: TriangleMesh,
    positions: Vec<[f32; 3]>,
}

impl Alone {
    /// Prepares them.
    pub fn new(sequence: &Sequence) -> Self {
        let mesh = &sequence.current;
        let positions = rounded(&mesh.positions);
        let raw = raw(mesh);
        let received = triangle_mesh(mesh);
        let repaired = repair(&received).mesh;
        Self {
            files: [
                ("parse PLY", Format::Ply, ply::write(mesh)),
                ("parse OBJ", Format::Obj, obj::write(mesh)),
                ("parse GLB", Format::Glb, glb::write(mesh, None)),
                ("parse DRC", Format::Drc, draco(&positions, &mesh.faces)),
            ],
            raw,
            received,
            simplified: simplify(&repaired, None, &tenth(&repaired)).mesh,
            positions: rounded(&coordinates(&repaired)),
            repaired,
        }
    }

    /// Each of them.
    pub fn stages(&self) -> Vec<Stage<'_>> {
        let mut stages: Vec<Stage<'_>> = Vec::new();
        for (name, format, bytes) in &self.files {
            let run = || drop(black_box(read(bytes, *format, &LIMITS)));
            stages.push((name, Box::new(move || Box::new(run))));
        }
        let repair_one = |mesh: TriangleMesh| drop(black_box(repair(&mesh)));
        let simplify_one = |mesh: TriangleMesh| {
            let options = tenth(&mesh);
            drop(black_box(simplify(&mesh, None, &options)));
        };
        stages.push(("repair", on_fresh(&self.received, repair_one)));
        stages.push(("simplify off", on_fresh(&self.repaired, simplify_one)));
        stages.push(("meshopt", Box::new(|| Box::new(|| self.meshopt()))));
        stages.push(("encode", Box::new(|| Box::new(|| encode(&self.simplified)))));
        stages
    }

    /// To a tenth of the faces whatever the error.
    fn meshopt(&self) {
        let indices = self.repaired.faces().as_flattened();
        let vertices = meshopt::VertexDataAdapter::new(
            meshopt::typed_to_bytes(&self.positions),
            size_of::<[f32; 3]>(),
            0,
        )
        .expect("positions are twelve bytes each");
        let (target, options) = (indices.len() / 30 * 3, meshopt::SimplifyOptions::None);
        let simplified = meshopt::simplify(indices, &vertices, target, f32::MAX, options, None);
        drop(black_box(simplified));
    }
}

/// The stages that need the frame before.
pub struct Together {
    previous_raw: RawFrame,
    raw: RawFrame,
    previous: PreparedFrame,
    previous_output: Output,
    current: PreparedFrame,
    registered: TriangleMesh,
    registered_surface: TriangleTree,
    carried: Vec<Carried>,
    carried_mesh: TriangleMesh,
    output: TriangleMesh,
}

impl Together {
    /// Prepares them, which registers the frames.
    pub fn new(sequence: &Sequence, alone: &Alone) -> Self {
        let prepare = |raw| PreparedFrame::new(raw, &mut ()).expect("the frames are usable");
        let previous = prepare(raw(&sequence.previous));
        let current = prepare(alone.raw.clone());
        let tree = |mesh: &TriangleMesh| TriangleTree::new(mesh).expect("the frames have faces");
        let surface = Arc::new(tree(current.mesh()));
        let source = previous.mesh();
        let target = Target::of_surface(current.mesh(), Arc::clone(&surface));
        let options = registration::Options::default();
        let found = registration::register(source, &target, &options).expect("the frames fit");
        let near: Vec<u32> = found.closest.iter().map(|closest| closest.face).collect();
        let registered = moved(source, found.positions);
        let previous_output = simplify(source, None, &tenth(source)).mesh;
        let feet = closest_to_vertices(&previous_output, &tree(source));
        let points = previous_output.positions();
        let carried = registration::carry(points, &feet, (source, &registered), &near);
        let positions = carried.iter().map(|vertex| vertex.position).collect();
        Self {
            previous_raw: raw(&sequence.previous),
            raw: alone.raw.clone(),
            carried_mesh: moved(&previous_output, positions),
            registered_surface: tree(&registered),
            registered,
            carried,
            previous_output: previous_output.into(),
            previous,
            current,
            output: alone.simplified.clone(),
        }
    }

    /// Each of them.
    pub fn stages(&self) -> Vec<Stage<'_>> {
        vec![
            ("register", Box::new(|| self.register())),
            ("simplify robust", Box::new(|| self.simplify_robust())),
            ("simplify paper", Box::new(|| self.simplify_paper())),
            ("measure full", Box::new(|| self.measure(MetricsMode::Full))),
            (
                "measure sampled",
                Box::new(|| self.measure(MetricsMode::Sampled)),
            ),
            ("process", Box::new(|| self.process())),
        ]
    }

    fn register(&self) -> Run<'_> {
        let (source, current) = (fresh(self.previous.mesh()), fresh(self.current.mesh()));
        // Its own simplification asked for them.
        black_box((source.vertex_normals(), source.mean_edge()));
        let tree = TriangleTree::new(&current).expect("the frames have faces");
        Box::new(move || {
            let target = Target::of_surface(&current, Arc::new(tree));
            let options = registration::Options::default();
            drop(black_box(registration::register(
                &source, &target, &options,
            )));
        })
    }

    fn simplify_robust(&self) -> Run<'_> {
        let mesh = fresh(self.current.mesh());
        let surface = TriangleTree::new(&mesh).expect("the frames have faces");
        Box::new(move || {
            let previous = (self.carried.as_slice(), self.carried_mesh.faces());
            let options = anchors::Options::with_strength(0.5);
            let anchors = Anchors::new(previous, &surface, &options);
            drop(black_box(simplify_anchored(
                &surface,
                &anchors,
                &tenth(&mesh),
            )));
        })
    }

    fn simplify_paper(&self) -> Run<'_> {
        let mesh = fresh(self.current.mesh());
        Box::new(move || {
            let simplified = simplify(&mesh, Some(&self.registered), &tenth(&mesh));
            drop(black_box(simplified));
        })
    }

    fn measure(&self, mode: MetricsMode) -> Run<'_> {
        Box::new(move || self.measure_now(mode))
    }

    fn measure_now(&self, mode: MetricsMode) {
        let surface = TriangleTree::new(&self.output).expect("the output has faces");
        let mut metrics = FrameMetrics::default();
        let samples = if mode == MetricsMode::Full {
            usize::MAX
        } else {
            1000
        };
        let output = Output::from(self.output.clone());
        let frames = (&self.current, Some(&self.registered_surface));
        add_distances(&mut metrics, (&output, &surface), frames, mode);
        let consistency = consistency_with_surface(&self.carried_mesh, &surface, samples);
        drop(black_box((metrics, consistency)));
    }

    /// From the parsed frame on, as a stream does it by default.
    fn process(&self) -> Run<'_> {
        let prepare = |raw| PreparedFrame::new(raw, &mut ()).expect("the frame is usable");
        let settings = Settings {
            target: TargetSize::Ratio(0.1),
            ..Settings::default()
        };
        let previous = prepare(self.previous_raw.clone());
        // As it comes out of its own turn.
        pipeline::process(&previous, None, &settings, &mut ()).ok();
        Box::new(move || {
            let current = prepare(self.raw.clone());
            let previous = Some(Previous {
                frame: &previous,
                output: Some(&self.previous_output),
            });
            let processed = pipeline::process(&current, previous, &settings, &mut ());
            drop(black_box(processed));
        })
    }
}

/// Runs something on a mesh that nobody has looked at.
fn on_fresh<'a>(mesh: &'a TriangleMesh, run: fn(TriangleMesh)) -> Box<dyn Fn() -> Run<'a> + 'a> {
    Box::new(move || {
        let mesh = fresh(mesh);
        Box::new(move || run(mesh))
    })
}

/// The same mesh, with nothing derived from it yet.
fn fresh(mesh: &TriangleMesh) -> TriangleMesh {
    let copy = TriangleMesh::new(mesh.positions().to_vec(), mesh.faces().to_vec());
    copy.expect("it is a mesh")
}

fn tenth(mesh: &TriangleMesh) -> Options {
    Options::to_faces(mesh.face_count() / 10)
}

fn raw(mesh: &Mesh) -> RawFrame {
    RawFrame {
        positions: mesh.positions.clone(),
        faces: mesh.faces.clone(),
        ..RawFrame::default()
    }
}

fn triangle_mesh(mesh: &Mesh) -> TriangleMesh {
    let positions = mesh.positions.iter().map(|&p| Point::from(p)).collect();
    TriangleMesh::new(positions, mesh.faces.clone()).expect("the frames are meshes")
}

fn moved(mesh: &TriangleMesh, positions: Vec<Point>) -> TriangleMesh {
    let moved = mesh.with_positions(positions);
    moved.expect("a registration is finite").rounded_to_f32()
}

fn coordinates(mesh: &TriangleMesh) -> Vec<[f64; 3]> {
    mesh.positions().iter().map(|p| p.coords.into()).collect()
}

fn rounded(positions: &[[f64; 3]]) -> Vec<[f32; 3]> {
    positions.iter().map(|p| p.map(|c| c as f32)).collect()
}

fn draco(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Vec<u8> {
    let view = MeshView {
        positions,
        point_vertices: None,
        faces,
        normals: None,
        colors: None,
        materials: None,
        texture_coordinates: None,
    };
    steadymesh_draco::encode(&view, &EncodeOptions::default()).expect("the mesh is valid")
}

/// To Draco and back, as a frame is delivered.
fn encode(mesh: &TriangleMesh) {
    let bytes = draco(&rounded(&coordinates(mesh)), mesh.faces());
    let limits = DecodeLimits {
        max_vertices: usize::MAX,
        max_faces: usize::MAX,
        max_memory_bytes: usize::MAX,
    };
    drop(black_box(steadymesh_draco::decode(&bytes, &limits)));
}
