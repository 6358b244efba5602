//! How close simplified textured frames look to their originals, beside meshoptimizer.
//!
//! ```text
//! cargo run --release --example textured -- FACES DIRECTORY FRAME.obj IMAGE [FRAME.obj IMAGE ...]
//! ```
//!
//! Prints two tables, of the textured frames and of the same with a color for every vertex, and writes pictures into the directory. The frames are one sequence. All
//! results go through Draco with the server's default settings; PSNR is that of 16 views from
//! around together, where either of the two shows the mesh.

#![allow(clippy::print_stdout, reason = "its output is the table")]

mod colors;
mod render;

use std::path::Path;

use anyhow::{Context, bail};
use image::{RgbImage, imageops};
use meshopt::{SimplifyOptions, VertexDataAdapter};
use render::{Textured, Views, difference};
use steadymesh::pipeline::{
    AttributeWeight, PreparedFrame, Previous, RawFrame, Settings, TargetSize, process,
};
use steadymesh_draco::{DecodeLimits, EncodeOptions, MeshView};
use steadymesh_mesh_io::{Limits, Mesh, obj};
use steadymesh_proto::metrics::Tracking;
use steadymesh_proto::stream::MetricsMode;

const VIEWS: u32 = 16;
const SIZE: u32 = 768;

/// Weights of meshoptimizer's texture coordinates, relative to the extent of the mesh: what its
/// users try.
const WEIGHTS: [f32; 5] = [0.1, 0.3, 1.0, 3.0, 10.0];

/// How frames are simplified: tracking and the weight of the attributes.
const RUNS: [(Tracking, f64); 4] = [
    (Tracking::Off, 0.0),
    (Tracking::Off, 0.01),
    (Tracking::Robust, 0.0),
    (Tracking::Robust, 0.01),
];

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [faces, directory, files @ ..] = &arguments[..] else {
        bail!("FACES DIRECTORY FRAME.obj IMAGE ...");
    };
    let target: usize = faces.parse().context("FACES")?;
    let mut previous: [Option<PreparedFrame>; RUNS.len()] = Default::default();
    let mut outputs = [const { None }; RUNS.len()];
    println!("| frame | simplified by | faces | PSNR (dB) |");
    println!("| --- | --- | ---: | ---: |");
    for pair in files.chunks_exact(2) {
        let mesh = read(&pair[0])?;
        let texture = image::open(&pair[1])?.into_rgb8();
        let original = textured(&mesh)?;
        let scene = Scene::new(&original, &texture);
        let name = name_of(&pair[0]);
        for (index, (tracking, weight)) in RUNS.into_iter().enumerate() {
            let raw = RawFrame {
                has_image: true,
                ..RawFrame::from_mesh(mesh.clone(), 0)
            };
            let frame = PreparedFrame::new(raw, &mut ())?;
            let settings = Settings {
                target: TargetSize::Faces(target),
                tracking,
                attribute_weight: AttributeWeight::new(weight)?,
                metrics: MetricsMode::Off,
                ..Settings::default()
            };
            let before = previous[index].as_ref().map(|frame| Previous {
                frame,
                output: outputs[index].as_ref(),
            });
            let processed = process(&frame, before, &settings, &mut ())?;
            let result = decoded(&processed.draco)?;
            let mut by = format!("Steadymesh, `{tracking:?}`").to_lowercase();
            if 0.0 < weight {
                by += &format!(", `attribute_weight` {weight}");
            }
            scene.report(&name, &by, &result, Path::new(directory))?;
            previous[index] = Some(frame);
            outputs[index] = Some(processed.output);
        }
        for moves in [false, true] {
            let mut best: Option<(f64, f32, Textured)> = None;
            for weight in WEIGHTS {
                let result = meshoptimizer(&original, target, weight, moves)?;
                let psnr = scene.psnr(&result);
                if best.as_ref().is_none_or(|(found, ..)| *found < psnr) {
                    best = Some((psnr, weight, result));
                }
            }
            if let Some((_, weight, result)) = best {
                let function = if moves {
                    "WithUpdate"
                } else {
                    "WithAttributes"
                };
                let by = format!("meshoptimizer `simplify{function}`, weight {weight}");
                scene.report(&name, &by, &result, Path::new(directory))?;
            }
        }
    }
    println!(
        "\n| frame | `attribute_weight` | color error (of 255) | distance (% of the diagonal) |"
    );
    println!("| --- | ---: | ---: | ---: |");
    for pair in files.chunks_exact(2) {
        let mesh = read(&pair[0])?;
        let texture = image::open(&pair[1])?.into_rgb8();
        let original = textured(&mesh)?;
        colors::report(&name_of(&pair[0]), (&mesh, &original), &texture, target)?;
    }
    Ok(())
}

fn name_of(path: &str) -> String {
    let name = Path::new(path).file_stem().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

struct Scene<'a> {
    views: Views,
    texture: &'a RgbImage,
    originals: Vec<render::Picture>,
}

impl<'a> Scene<'a> {
    fn new(original: &Textured, texture: &'a RgbImage) -> Self {
        let views = Views::of(original, SIZE);
        let take = |view: u32| views.take(original, texture, view as f32 / VIEWS as f32);
        Self {
            originals: (0..VIEWS).map(take).collect(),
            views,
            texture,
        }
    }

    fn psnr(&self, mesh: &Textured) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for (original, view) in self.originals.iter().zip(0..) {
            let picture = self
                .views
                .take(mesh, self.texture, view as f32 / VIEWS as f32);
            let (square, channels) = difference(original, &picture);
            sum += square;
            count += channels;
        }
        10.0 * (255.0 * 255.0 * count as f64 / sum).log10()
    }

    fn report(&self, name: &str, by: &str, mesh: &Textured, to: &Path) -> anyhow::Result<()> {
        println!(
            "| {name} | {by} | {} | {:.2} |",
            mesh.faces.len(),
            self.psnr(mesh)
        );
        let mut sheet = RgbImage::new(4 * SIZE, 2 * SIZE);
        for (column, view) in [0, 4, 8, 12].into_iter().enumerate() {
            let turn = view as f32 / VIEWS as f32;
            let picture = self.views.take(mesh, self.texture, turn);
            let x = i64::from(SIZE) * column as i64;
            imageops::replace(&mut sheet, &self.originals[view].image, x, 0);
            imageops::replace(&mut sheet, &picture.image, x, i64::from(SIZE));
        }
        let file: String = by.chars().filter(char::is_ascii_alphanumeric).collect();
        std::fs::create_dir_all(to)?;
        sheet.save(to.join(format!("{name}-{file}.png")))?;
        Ok(())
    }
}

fn read(path: &str) -> anyhow::Result<Mesh> {
    let limits = Limits {
        max_vertices: 1 << 24,
        max_faces: 1 << 24,
        max_memory_bytes: 1 << 30,
    };
    Ok(obj::read(&std::fs::read(path)?, &limits)?)
}

fn textured(mesh: &Mesh) -> anyhow::Result<Textured> {
    let mesh = mesh.with_attributes_per_vertex().into_owned();
    let coordinates = mesh.texture_coordinates.context("no texture coordinates")?;
    Ok(Textured {
        positions: mesh.positions.iter().map(|p| p.map(|c| c as f32)).collect(),
        faces: mesh.faces,
        coordinates: coordinates.values,
    })
}

fn decoded(draco: &[u8]) -> anyhow::Result<Textured> {
    let limits = DecodeLimits {
        max_vertices: usize::MAX,
        max_faces: usize::MAX,
        max_memory_bytes: usize::MAX,
    };
    let mesh = steadymesh_draco::decode(draco, &limits)?;
    Ok(Textured {
        positions: mesh.positions,
        faces: mesh.faces,
        coordinates: mesh.texture_coordinates.context("no texture coordinates")?,
    })
}

fn meshoptimizer(
    original: &Textured,
    target: usize,
    weight: f32,
    moves: bool,
) -> anyhow::Result<Textured> {
    let mut indices = original.faces.as_flattened().to_vec();
    let mut positions = original.positions.clone();
    let mut coordinates = original.coordinates.clone();
    let weights = [weight; 2];
    let options = SimplifyOptions::None;
    if moves {
        let count = meshopt::simplify_with_update(
            &mut indices,
            &mut positions,
            coordinates.as_flattened_mut(),
            &weights,
            8,
            None,
            3 * target,
            f32::MAX,
            options,
            None,
        );
        indices.truncate(count);
    } else {
        let bytes: Vec<u8> = positions
            .as_flattened()
            .iter()
            .flat_map(|c| c.to_ne_bytes())
            .collect();
        let vertices = VertexDataAdapter::new(&bytes, 12, 0)?;
        let unlocked: &[bool] = &vec![false; positions.len()];
        indices = meshopt::simplify_with_attributes_and_locks(
            &indices,
            &vertices,
            coordinates.as_flattened(),
            &weights,
            8,
            unlocked,
            3 * target,
            f32::MAX,
            options,
            None,
        );
    }
    let faces: Vec<[u32; 3]> = indices
        .chunks_exact(3)
        .map(|f| [f[0], f[1], f[2]])
        .collect();
    let view = MeshView {
        positions: &positions,
        point_vertices: None,
        faces: &faces,
        normals: None,
        colors: None,
        materials: None,
        texture_coordinates: Some(&coordinates),
    };
    decoded(&steadymesh_draco::encode(&view, &EncodeOptions::default())?)
}
