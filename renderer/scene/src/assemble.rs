//! Puts parts together into a [`Scene`]: drops bad triangles, adds missing normals, light and camera.

use std::path::{Path, PathBuf};
use std::{ops::Range, sync::Arc};

use glam::{Affine3A, DVec3, Vec2, Vec3, Vec3A};
use treewright_accel::limits::{COORDINATE_MAX, TRIANGLES_MAX};
use treewright_accel::{GeometryError, Triangles};

use super::animation::{Animated, Rig};
use super::framing::{self, CameraPose};
use super::limits::{CAMERAS_MAX, FOV_RANGE_DEG, MESHES_MAX, PUNCTUAL_LIGHTS_MAX, VERTICES_MAX};
use super::place::{Lengths, Placement};
use super::texture::{Encoding, Wrap};
use super::textures::{Textures, cut_out};
use super::{
    Camera, Material, Mesh, Placed, Punctual, Scene, SceneError, Sky, Up, bounds::Bounds, images::Pixels,
    objects::Objects, part::Part, text::counted,
};

/// Marks a vertex that no kept triangle names.
const UNUSED: u32 = u32::MAX;

/// Collects meshes and materials of one scene.
#[derive(Default)]
pub struct Assembler {
    name: String,
    origin: PathBuf,
    up: Up,
    positions: Vec<Vec3A>,
    normals: Vec<Vec3>,
    /// Parallel to the positions, zero where a mesh has none.
    uvs: Vec<Vec2>,
    /// Whether any mesh has texture coordinates.
    has_uvs: bool,
    indices: Vec<[u32; 3]>,
    meshes: Vec<Mesh>,
    /// Whether each mesh came without normals.
    flat: Vec<bool>,
    materials: Vec<Material>,
    textures: Textures,
    lights: Vec<Punctual>,
    notes: Vec<String>,
    /// Triangles that are left out: with a corner that is not finite, and with one too far out.
    not_finite: usize,
    too_far: usize,
    objects: Objects,
    /// The positions outside objects.
    in_world: Vec<Range<usize>>,
    placement: Placement,
    /// The box around everything outside objects.
    world: Bounds,
    /// The parts that the file's animations move.
    rig: Option<Rig>,
    /// By position: the vertex of the rig that it is. Ends with the last one that is any, until the end.
    sources: Vec<u32>,
    /// The first vertex of the mesh that is added next, among those of the rig.
    first_source: Option<u32>,
}

/// The light of a scene from outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lighting {
    /// As given.
    Given(Sky),
    /// Black when a mesh shines or there is a light without size, daylight (and a note) when none does.
    Automatic,
}

impl Assembler {
    /// An empty scene named by a file's stem. Added geometry is turned so that this axis points up.
    pub fn of_file(path: &Path, up: Up) -> Self {
        let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        Self { up, ..Self::new(stem.unwrap_or_else(|| "scene".to_owned()), path) }
    }

    /// The scene's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// An empty scene. `origin` is named in errors.
    pub fn new(name: impl Into<String>, origin: &Path) -> Self {
        Self { name: name.into(), origin: origin.to_owned(), ..Self::default() }
    }

    /// Notes that added parts have been moved, so that this place of the file is the origin.
    pub(crate) fn moved_to(&mut self, origin: DVec3) {
        self.placement.origin = self.up.turned_far(origin);
    }

    /// Adds a material, its numbers brought into range, and returns its index.
    pub fn material(&mut self, material: Material) -> u32 {
        self.materials.push(sanitized(material));
        (self.materials.len() - 1) as u32
    }

    /// Replaces every material so far by one.
    pub fn repaint(&mut self, material: Material) {
        self.materials.fill(sanitized(material));
    }

    /// Adds or finds a texture by key, encoding and wrap; `make` decodes it. A failure leaves a note.
    pub(crate) fn texture(
        &mut self,
        key: &str,
        name: &str,
        encoding: Encoding,
        wrap: [Wrap; 2],
        make: impl FnOnce() -> Result<Pixels, String>,
    ) -> Option<u32> {
        self.textures.add(key, name, encoding, wrap, make)
    }

    /// Whether a texture's alpha cuts out: nearly everywhere clear or solid, and both somewhere.
    pub(crate) fn cuts_out(&self, texture: u32) -> bool {
        self.textures.cuts_out(texture)
    }

    /// Adds a sentence about an omission or an addition.
    pub fn note(&mut self, note: impl Into<String>) {
        self.notes.push(note.into());
    }

    /// Adds a sentence about a count, which stands in place of `{}`, unless it is 0.
    pub(crate) fn note_count(&mut self, count: usize, sentence: &str) {
        self.notes.extend(counted(count, sentence));
    }

    /// Adds lights without size. Dark, not finite and too many ones are left out with a note.
    pub fn lights(&mut self, mut lights: Vec<Punctual>) {
        let all = lights.len();
        lights.retain(Punctual::is_sound);
        let dark = "Left out {} lights that give no light or have numbers that are not finite.";
        self.note_count(all - lights.len(), dark);
        if lights.len() > PUNCTUAL_LIGHTS_MAX {
            self.note(format!("Took the first {PUNCTUAL_LIGHTS_MAX} of {} lights.", lights.len()));
            lights.truncate(PUNCTUAL_LIGHTS_MAX);
        }
        self.lights.extend(lights.into_iter().map(|light| light.turned(self.up)));
    }

    /// Begins an object for [`Assembler::place`]: meshes up to [`Assembler::end_object`] are in its space.
    pub fn begin_object(&mut self) {
        self.objects.begin(self.indices.len() as u32, self.positions.len());
    }

    /// Ends the object and returns its number.
    pub fn end_object(&mut self) -> u32 {
        self.objects.end(self.indices.len() as u32, &self.positions)
    }

    /// Places an object. Says no to, and counts, transformations without inverse or too far out.
    pub fn place(&mut self, object: u32, to_world: Affine3A) -> bool {
        self.objects.place(object, Affine3A::from_mat3(self.up.matrix()) * to_world)
    }

    /// Says that the mesh that is added next moves: the number of its first vertex among those of the rig.
    pub(crate) fn moves_from(&mut self, first: u32) {
        self.first_source = Some(first);
    }

    pub(crate) fn animate(&mut self, rig: Rig) {
        self.rig = Some(rig);
    }

    /// Adds a mesh in world space or in an open object's. Triangles wound against their normals are turned
    /// round, bad ones dropped and counted; an empty mesh leaves no trace.
    pub fn mesh(&mut self, name: impl Into<String>, material: u32, part: &Part) -> Result<(), SceneError> {
        let (name, first_source) = (name.into(), self.first_source.take());
        let refuse = |source| SceneError::Geometry { path: self.origin.clone(), mesh: name.clone(), source };
        let vertices = part.positions.len();
        if self.indices.len() + part.indices.len() > TRIANGLES_MAX {
            return Err(refuse(GeometryError::TooMany(self.indices.len() + part.indices.len())));
        }
        if self.meshes.len() >= MESHES_MAX || self.positions.len() + vertices > VERTICES_MAX {
            return Err(SceneError::TooMany(self.origin.clone()));
        }
        let first_triangle = self.indices.len() as u32;
        let first_position = self.positions.len();
        let mut renumbered = vec![UNUSED; vertices];
        // The contents of an object are turned where it is placed.
        let up = if self.objects.is_open() { Up::Y } else { self.up };
        let has_normals = part.normals.len() == vertices && vertices > 0;
        let has_uvs = part.uvs.len() == vertices && vertices > 0;
        self.has_uvs |= has_uvs;
        let mut fallback: Option<Vec<Vec3>> = None;
        for (triangle, corners) in part.indices.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|vertex| **vertex as usize >= vertices) {
                return Err(refuse(GeometryError::IndexOutOfRange { triangle, vertex, vertices }));
            }
            let all = |good: fn(Vec3) -> bool| corners.iter().all(|at| good(part.positions[*at as usize]));
            if !all(|at| at.abs().cmple(Vec3::splat(COORDINATE_MAX)).all()) {
                let count = if all(Vec3::is_finite) { &mut self.too_far } else { &mut self.not_finite };
                *count += 1;
                continue;
            }
            let mut kept = [0; 3];
            for (corner, vertex) in corners.iter().enumerate() {
                let vertex = *vertex as usize;
                if renumbered[vertex] == UNUSED {
                    renumbered[vertex] = self.positions.len() as u32;
                    let position = up.turned(part.positions[vertex]);
                    self.positions.push(position.into());
                    if let Some(first) = first_source {
                        self.sources.resize(self.positions.len() - 1, UNUSED);
                        self.sources.push(first + vertex as u32);
                    }
                    let uv = if has_uvs { part.uvs[vertex] } else { Vec2::ZERO };
                    self.uvs.push(if uv.is_finite() { uv } else { Vec2::ZERO });
                    if !self.objects.is_open() {
                        self.world = self.world.union(&Bounds { min: position, max: position });
                    }
                    let normal =
                        if has_normals { part.normals[vertex].normalize_or_zero() } else { Vec3::ZERO };
                    let normal = if has_normals && normal == Vec3::ZERO {
                        fallback.get_or_insert_with(|| part.smooth_normals())[vertex]
                    } else {
                        normal
                    };
                    self.normals.push(up.turned(normal));
                }
                kept[corner] = renumbered[vertex];
            }
            // Exporters disagree about winding, but normals point outward nearly always.
            let [a, b, c] = kept.map(|vertex| self.positions[vertex as usize]);
            let outward: Vec3 = kept.iter().map(|vertex| self.normals[*vertex as usize]).sum();
            if Vec3::from((b - a).cross(c - a)).dot(outward) < 0.0 {
                kept.swap(1, 2);
            }
            self.indices.push(kept);
        }
        if !self.objects.is_open() {
            self.in_world.push(first_position..self.positions.len());
        }
        let triangle_count = self.indices.len() as u32 - first_triangle;
        if triangle_count > 0 {
            self.meshes.push(Mesh { name, first_triangle, triangle_count, material });
            self.flat.push(!has_normals);
        }
        Ok(())
    }

    /// The box around all parts and instances so far.
    pub fn bounds(&self) -> Bounds {
        let bounds = self.objects.placed_boxes().fold(self.world, |all, one| all.union(&one));
        if bounds.min.x > bounds.max.x { Bounds { min: Vec3::ZERO, max: Vec3::ZERO } } else { bounds }
    }

    /// The finished scene. `views` are the source's cameras; without any, one is made up.
    pub fn finish(mut self, lighting: Lighting, mut views: Vec<CameraPose>) -> Result<Scene, SceneError> {
        if self.indices.is_empty() {
            let mut found = std::mem::take(&mut self.notes);
            found
                .extend(self.dropped().map(|(count, what)| format!("{count} triangles have corners {what}")));
            let found = if found.is_empty() { "no faces".to_owned() } else { found.join("; ") };
            return Err(SceneError::NoTriangles(self.origin, found));
        }
        let notes =
            self.dropped().map(|(count, what)| format!("Dropped {count} triangles with corners {what}."));
        let notes: Vec<String> = notes.collect();
        self.notes.extend(notes);
        if self.materials.is_empty() {
            self.materials.push(Material::default());
        }
        self.settle_placement(&mut views);
        if self.rig.is_some() {
            self.sources.resize(self.positions.len(), UNUSED);
        }
        self.settle_normals();
        let sky = self.settle_sky(lighting);
        let refuse =
            |source| SceneError::Geometry { path: self.origin.clone(), mesh: self.name.clone(), source };
        let triangles = Triangles::new(self.positions, self.indices).map_err(refuse)?;
        let triangles = cut_out(triangles, &self.meshes, &self.materials, &self.textures, &self.uvs);
        let triangles = triangles.map_err(refuse)?;
        let is_used = |mesh: &Mesh| self.materials[mesh.material as usize].is_textured();
        let is_textured = self.has_uvs && self.meshes.iter().any(is_used);
        self.textures.finish(&mut self.notes);
        let flat = "Kept {} triangles without area; no ray meets them.";
        self.notes.extend(counted(zero_area_count(&triangles), flat));
        let instances = self
            .objects
            .finish(triangles.len(), &mut self.notes)
            .map_err(|placed| SceneError::TooManyPlaced(self.origin.clone(), placed))?;
        let placed = Placed::new(&triangles, instances.as_ref());
        let bounds = placed.bounds();
        if views.len() > CAMERAS_MAX {
            self.notes.push(format!("Took the first {CAMERAS_MAX} of {} cameras.", views.len()));
            views.truncate(CAMERAS_MAX);
        }
        let strange = views.iter().filter(|view| !FOV_RANGE_DEG.contains(&view.vertical_fov_deg)).count();
        let (least, most) = (FOV_RANGE_DEG.start(), FOV_RANGE_DEG.end());
        let moved = format!("Moved the angle of view of {{}} cameras to between {least} and {most} degrees.");
        self.notes.extend(counted(strange, &moved));
        let turned = |view: &CameraPose| CameraPose {
            position: self.up.turned(view.position),
            forward: self.up.turned(view.forward),
            up: self.up.turned(view.up),
            ..*view
        };
        let mut cameras: Vec<Camera> = views.iter().filter_map(|view| turned(view).aim(&bounds)).collect();
        if cameras.is_empty() {
            let (camera, what) = framing::made_up(&placed, &bounds);
            cameras.push(camera);
            self.notes.push(format!("The scene has no camera; {what}"));
        }
        Ok(Scene {
            name: self.name,
            triangles: Arc::new(triangles),
            instances: instances.map(Arc::new),
            normals: self.normals,
            uvs: if is_textured { self.uvs } else { Vec::new() },
            textures: if is_textured { self.textures.all } else { Vec::new() },
            meshes: self.meshes,
            materials: self.materials,
            sky,
            lights: self.lights,
            environment: None,
            cameras,
            path_keys: Vec::new(),
            animated: self.rig.map(|rig| Animated::new(rig, self.sources, &self.placement, self.up)),
            placement: self.placement,
            notes: self.notes,
        })
    }

    /// The triangles that are left out, and why.
    fn dropped(&self) -> impl Iterator<Item = (usize, String)> + use<> {
        let reasons = [
            (self.not_finite, "that are not finite".to_owned()),
            (self.too_far, format!("that are too far out, beyond ±{COORDINATE_MAX:e}")),
        ];
        reasons.into_iter().filter(|(count, _)| *count > 0)
    }

    /// Brings lengths and places into the range of single precision.
    fn settle_placement(&mut self, views: &mut [CameraPose]) {
        let bounds = self.bounds();
        let Self { positions, in_world, objects, lights, materials, .. } = self;
        let mut lengths = Lengths { positions, in_world, objects, lights, materials, views };
        let notes = lengths.settle(bounds, &mut self.placement);
        self.notes.extend(notes);
    }

    /// Leaves no normals when every mesh is flat; else gives flat ones three vertices a triangle.
    fn settle_normals(&mut self) {
        if self.flat.iter().all(|flat| *flat) {
            self.normals = Vec::new();
            return;
        }
        for (mesh, _) in self.meshes.iter().zip(&self.flat).filter(|(_, flat)| **flat) {
            let range = mesh.first_triangle as usize..(mesh.first_triangle + mesh.triangle_count) as usize;
            for triangle in &mut self.indices[range] {
                let corners = triangle.map(|vertex| self.positions[vertex as usize]);
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(Vec3A::Y);
                let first = self.positions.len() as u32;
                self.positions.extend(corners);
                let uvs = triangle.map(|vertex| self.uvs[vertex as usize]);
                self.uvs.extend(uvs);
                if self.rig.is_some() {
                    let sources = triangle.map(|vertex| self.sources[vertex as usize]);
                    self.sources.extend(sources);
                }
                self.normals.extend([Vec3::from(normal); 3]);
                *triangle = [first, first + 1, first + 2];
            }
        }
        // No triangle uses the vertices that flat meshes left behind, but they keep the arrays complete.
        for normal in &mut self.normals {
            if *normal == Vec3::ZERO {
                *normal = Vec3::Y;
            }
        }
    }

    fn settle_sky(&mut self, lighting: Lighting) -> Sky {
        let shines = |mesh: &Mesh| self.materials[mesh.material as usize].emission.max_element() > 0.0;
        match lighting {
            Lighting::Given(sky) => sky.turned(self.up),
            Lighting::Automatic if !self.lights.is_empty() || self.meshes.iter().any(shines) => Sky::BLACK,
            Lighting::Automatic => {
                self.notes.push("The scene has no light; a daylight sky was added.".to_owned());
                Sky::daylight()
            }
        }
    }
}

fn zero_area_count(triangles: &Triangles) -> usize {
    (0..triangles.len())
        .filter(|triangle| {
            let [a, b, c] = triangles.corners(*triangle);
            (b - a).cross(c - a) == Vec3A::ZERO
        })
        .count()
}

/// Brings a material's numbers into the ranges its fields promise; NaN becomes the default.
fn sanitized(material: Material) -> Material {
    let default = Material::default();
    let finite = |value: Vec3, default: Vec3| if value.is_finite() { value } else { default };
    let unit = |value: f32, default: f32| {
        if value.is_finite() { value.clamp(0.0, 1.0) } else { default }
    };
    Material {
        base_color: finite(material.base_color, default.base_color).clamp(Vec3::ZERO, Vec3::ONE),
        metallic: unit(material.metallic, default.metallic),
        roughness: unit(material.roughness, default.roughness),
        transmission: unit(material.transmission, default.transmission),
        ior: if material.ior.is_finite() { material.ior.clamp(1.0, 4.0) } else { default.ior },
        emission: finite(material.emission, default.emission).max(Vec3::ZERO),
        normal_scale: if material.normal_scale.is_finite() { material.normal_scale } else { 1.0 },
        cutoff: material.cutoff.map(|cutoff| if cutoff >= 0.0 { cutoff } else { 0.0 }),
        opacity: unit(material.opacity, default.opacity),
        volume: material.volume.filter(|volume| volume.absorption.is_finite()),
        ..material
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(shift: f32) -> Part {
        Part {
            positions: vec![
                Vec3::new(shift, 0.0, 0.0),
                Vec3::new(shift + 1.0, 0.0, 0.0),
                Vec3::new(shift, 1.0, 0.0),
            ],
            indices: vec![[0, 1, 2]],
            ..Part::default()
        }
    }

    fn assembler() -> Assembler {
        let mut assembler = Assembler::new("test", Path::new("test.obj"));
        assembler.material(Material::default());
        assembler
    }

    #[test]
    fn bad_corners_drop_a_triangle_and_zero_area_is_kept() {
        let mut assembler = assembler();
        let mut part = triangle(0.0);
        part.positions.extend([Vec3::NAN, Vec3::new(1e20, 0.0, 0.0)]);
        part.indices.extend([[0, 1, 3], [0, 1, 4], [0, 1, 1]]);
        assembler.mesh("m", 0, &part).unwrap();
        let scene = assembler.finish(Lighting::Automatic, vec![]).unwrap();
        assert_eq!(scene.triangles.len(), 2);
        assert_eq!(scene.triangles.positions().len(), 3);
        let dropped = |what: &str| scene.notes.iter().any(|note| note.contains(what));
        assert!(dropped("Dropped 1 triangles with corners that are not finite."));
        assert!(dropped("Dropped 1 triangles with corners that are too far out, beyond"));
        assert!(scene.notes.iter().any(|note| note.starts_with("Kept 1 ")));
        assert!(scene.normals.is_empty());
        assert_eq!(scene.sky, Sky::daylight());
    }

    #[test]
    fn flat_and_smooth_meshes_share_one_normal_array() {
        let mut assembler = assembler();
        assembler.mesh("flat", 0, &triangle(0.0)).unwrap();
        assert!(assembler.sources.is_empty(), "it does not move");
        let mut smooth = triangle(3.0);
        smooth.normals = vec![Vec3::new(0.0, 3.0, 4.0), Vec3::ZERO, Vec3::NAN];
        assembler.mesh("smooth", 0, &smooth).unwrap();
        let scene = assembler.finish(Lighting::Automatic, vec![]).unwrap();
        assert_eq!(scene.normals.len(), scene.triangles.positions().len());
        let normals =
            |triangle: usize| scene.triangles.indices()[triangle].map(|v| scene.normals[v as usize]);
        assert_eq!(normals(0), [Vec3::Z; 3]);
        assert!((normals(1)[0] - Vec3::new(0.0, 0.6, 0.8)).length() < 1e-6);
        // The zero and the NaN normal were replaced by the triangle's own.
        assert_eq!(normals(1)[1..], [Vec3::Z; 2]);
    }

    #[test]
    fn winding_follows_the_normals() {
        let mut assembler = assembler();
        let mut part = triangle(0.0);
        part.normals = vec![Vec3::NEG_Z; 3];
        assembler.mesh("inside out", 0, &part).unwrap();
        let scene = assembler.finish(Lighting::Automatic, vec![]).unwrap();
        let [a, b, c] = scene.triangles.corners(0);
        assert!((b - a).cross(c - a).z < 0.0);
    }

    #[test]
    fn shining_meshes_keep_the_sky_black() {
        let mut assembler = assembler();
        let lamp = assembler.material(Material { emission: Vec3::ONE, ..Material::default() });
        assembler.mesh("lamp", lamp, &triangle(0.0)).unwrap();
        assert_eq!(assembler.finish(Lighting::Automatic, vec![]).unwrap().sky, Sky::BLACK);
    }

    #[test]
    fn an_index_out_of_range_names_file_mesh_and_triangle() {
        let mut part = triangle(0.0);
        part.indices.push([0, 1, 7]);
        let message = assembler().mesh("wall", 0, &part).unwrap_err().to_string();
        assert!(
            message.contains("test.obj") && message.contains("wall") && message.contains("triangle 1"),
            "{message}"
        );
    }

    #[test]
    fn nothing_left_is_an_error() {
        let mut part = triangle(0.0);
        part.positions[2] = Vec3::INFINITY;
        let mut assembler = assembler();
        assembler.mesh("m", 0, &part).unwrap();
        let message = assembler.finish(Lighting::Automatic, vec![]).unwrap_err().to_string();
        assert!(message.contains("no triangle") && message.contains("not finite"), "{message}");
    }

    #[test]
    fn materials_are_brought_into_range() {
        let wild = Material {
            base_color: Vec3::new(2.0, -1.0, 0.5),
            metallic: f32::NAN,
            roughness: 7.0,
            transmission: -1.0,
            ior: 0.0,
            emission: Vec3::new(-1.0, 2.0, 0.0),
            cutoff: Some(f32::NAN),
            opacity: 3.0,
            normal_scale: f32::INFINITY,
            ..Material::default()
        };
        let tame = sanitized(wild);
        assert_eq!(tame.base_color, Vec3::new(1.0, 0.0, 0.5));
        assert_eq!((tame.metallic, tame.roughness, tame.transmission, tame.ior), (0.0, 1.0, 0.0, 1.0));
        assert_eq!(tame.emission, Vec3::new(0.0, 2.0, 0.0));
        assert_eq!((tame.cutoff, tame.opacity, tame.normal_scale), (Some(0.0), 1.0, 1.0));
    }
}
