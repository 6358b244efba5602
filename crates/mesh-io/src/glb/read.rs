//! glTF bytes to one mesh.

use super::accessor::Source;
use super::buffers::Buffers;
use super::document::{self, MeshEntry, TextureInfo, entry};
use super::primitive::{self, Mode, Room, Vertices};
use super::transform::Transform;
use super::{container, malformed, scene, texture};
use crate::mesh::materials_of_faces;
use crate::{Attribute, Limits, Mesh, ReadError, check};
use std::collections::{BTreeMap, BTreeSet};

/// Reads the triangles of a glTF file's default scene as one mesh: of a binary container (.glb)
/// or of JSON text (.gltf) whose buffers are `data:` URIs.
///
/// Meshes are put where their nodes place them (mirrored ones with their winding
/// turned) and appended in the order of the hierarchy; primitives of one mesh that
/// share their attributes share vertices. `NORMAL`, `COLOR_0` and `TEXCOORD_0` are
/// kept if every primitive has them, and so is which of them have the same material. The image is that of the materials' base color, if it is in the
/// file and all primitives that have one have the same. Points, lines, skins, morph targets, the rest
/// of the materials, and cameras are ignored.
///
/// # Errors
///
/// See [`ReadError`].
pub fn read(bytes: &[u8], limits: &Limits) -> Result<Mesh, ReadError> {
    if bytes.is_empty() {
        return Err(ReadError::EmptyBody);
    }
    let container = container::split(bytes)?;
    let document = document::parse(container.json)?;
    let buffers = Buffers::of(&document, container.bin, limits)?;
    let source = Source {
        document: &document,
        buffers: &buffers,
    };
    let mut builder = Builder::new(limits);
    for instance in scene::instances(&document)? {
        let mesh = entry(&document.meshes, instance.mesh, "mesh")?;
        builder.add_mesh(&source, mesh, &instance.world_from_local)?;
    }
    let image = texture::image(&source, &builder.images, bytes)?;
    Ok(Mesh {
        image,
        ..builder.finish()?
    })
}

/// What has been done so far: nodes can show one mesh many times, so a small file
/// could ask for endless work.
#[derive(Default)]
struct Work {
    primitives: usize,
    /// Triangles, the degenerate ones of strips included.
    faces: usize,
    draco_bytes: usize,
}

impl Work {
    fn count_primitive(&mut self) -> Result<(), ReadError> {
        const MOST: usize = 1 << 17;
        self.primitives += 1;
        if self.primitives > MOST {
            return Err(malformed(format!(
                "the scene shows more than {MOST} primitives"
            )));
        }
        Ok(())
    }

    fn count_draco(&mut self, length: usize, total: usize) -> Result<(), ReadError> {
        const MOST_TIMES: usize = 64;
        self.draco_bytes = self.draco_bytes.saturating_add(length);
        if self.draco_bytes > total.saturating_mul(MOST_TIMES) {
            return Err(malformed(format!(
                "the scene shows its Draco meshes more than {MOST_TIMES} times"
            )));
        }
        Ok(())
    }
}

struct Builder<'a> {
    limits: &'a Limits,
    work: Work,
    positions: Vec<[f64; 3]>,
    faces: Vec<[u32; 3]>,
    /// `None` once vertices came without.
    normals: Option<Vec<[f32; 3]>>,
    colors: Option<Vec<[u8; 4]>>,
    coordinates: Option<Vec<[f32; 2]>>,
    /// By face.
    materials: Vec<Option<usize>>,
    /// Those of the primitives so far.
    images: BTreeSet<usize>,
}

impl<'a> Builder<'a> {
    fn new(limits: &'a Limits) -> Self {
        Self {
            limits,
            work: Work::default(),
            positions: Vec::new(),
            faces: Vec::new(),
            normals: Some(Vec::new()),
            colors: Some(Vec::new()),
            coordinates: Some(Vec::new()),
            materials: Vec::new(),
            images: BTreeSet::new(),
        }
    }

    fn add_mesh(
        &mut self,
        source: &Source<'_>,
        mesh: &MeshEntry,
        world_from_local: &Transform,
    ) -> Result<(), ReadError> {
        // First vertex and number of vertices of the attributes that were added.
        let mut shared: BTreeMap<[Option<usize>; 5], (usize, usize)> = BTreeMap::new();
        for primitive in &mesh.primitives.0 {
            self.work.count_primitive()?;
            let Some(mode) = Mode::of(primitive)? else {
                continue;
            };
            let (info, image) = texture::base_color(source.document, primitive)?.unzip();
            self.images.extend(image);
            if let Some(draco) = &primitive.extensions.draco {
                let length = source.view(draco.buffer_view)?.0.len();
                self.work.count_draco(length, source.buffers.total())?;
                let (vertices, faces) =
                    primitive::decompress(source, primitive, draco, self.room())?;
                let (first, _) = self.add_vertices(vertices, world_from_local, info);
                self.work.faces += faces.len();
                self.add_faces(&faces, first, world_from_local);
                self.materials.resize(self.faces.len(), primitive.material);
                continue;
            }
            let [a, b, c, d] = primitive::vertex_key(primitive);
            // Its coordinates depend on how its texture is placed.
            let key = [a, b, c, d, primitive.material];
            let (first, count) = match shared.get(&key) {
                Some(&place) => place,
                None => {
                    let vertices = primitive::vertices(source, primitive, self.room())?;
                    let place = self.add_vertices(vertices, world_from_local, info);
                    shared.insert(key, place);
                    place
                }
            };
            let (faces, face_count) =
                primitive::faces(source, primitive, (mode, count), self.room())?;
            self.work.faces += face_count;
            self.add_faces(&faces, first, world_from_local);
            self.materials.resize(self.faces.len(), primitive.material);
        }
        Ok(())
    }

    fn room(&self) -> Room<'a> {
        Room {
            limits: self.limits,
            used_vertices: self.positions.len(),
            used_faces: self.work.faces,
        }
    }

    fn add_vertices(
        &mut self,
        mut vertices: Vertices,
        transform: &Transform,
        texture: Option<&TextureInfo>,
    ) -> (usize, usize) {
        let place = (self.positions.len(), vertices.positions.len());
        self.positions
            .extend(vertices.positions.iter().map(|&p| transform.point(p)));
        let normals = vertices.normals.map(|all| {
            all.into_iter()
                .map(|normal| transform.normal(normal))
                .collect()
        });
        if let Some(coordinates) = &mut vertices.coordinates {
            texture::place(coordinates, texture);
        }
        append(&mut self.normals, normals);
        append(&mut self.colors, vertices.colors);
        append(&mut self.coordinates, vertices.coordinates);
        place
    }

    fn add_faces(&mut self, faces: &[[u32; 3]], first: usize, transform: &Transform) {
        // The vertex limit, which was checked, is within 32 bits.
        let first = u32::try_from(first).unwrap_or(u32::MAX);
        let is_mirrored = transform.is_mirrored();
        self.faces.extend(faces.iter().map(|face| {
            let [a, b, c] = face.map(|index| index.saturating_add(first));
            if is_mirrored { [a, c, b] } else { [a, b, c] }
        }));
    }

    fn finish(mut self) -> Result<Mesh, ReadError> {
        if self.positions.is_empty() {
            return Err(ReadError::NoVertices { format: "glTF" });
        }
        if self.faces.is_empty() {
            return Err(ReadError::NoFaces {
                format: "glTF",
                vertices: self.positions.len(),
            });
        }
        check::positions(&self.positions)?;
        if let Some(normals) = &mut self.normals {
            check::clean_normals(normals);
        }
        if let Some(coordinates) = &self.coordinates {
            check::texture_coordinates(coordinates)?;
        }
        Ok(Mesh {
            positions: self.positions,
            faces: self.faces,
            normals: self.normals.map(Attribute::per_vertex),
            colors: self.colors.map(Attribute::per_vertex),
            texture_coordinates: self.coordinates.map(Attribute::per_vertex),
            materials: materials_of_faces(&self.materials),
            image: None,
        })
    }
}

fn append<T>(all: &mut Option<Vec<T>>, more: Option<Vec<T>>) {
    match (all.as_mut(), more) {
        (Some(all), Some(more)) => all.extend(more),
        _ => *all = None,
    }
}
