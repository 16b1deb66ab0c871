//! The seventeen indicators of a scene (paper Table 2), from the buffers that a renderer hands to Embree.

use std::ffi::CString;
use std::mem::MaybeUninit;
use std::sync::LazyLock;

use glam::{DAffine3, DVec3};
use treewright_client::Scale;
use treewright_indicators::{Accumulator, IndicatorScale, SCHEMA, SceneIndicators, Surface, View};

use crate::edge::{Array, Number, Strided, Text, need};
use crate::error::{Failure, c_text};
use crate::spec::Spec;

/// A mesh in the renderer's own buffers; see the header.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mesh {
    vertices: *const f32,
    vertex_stride: usize,
    vertex_count: usize,
    indices: *const u32,
    index_stride: usize,
    triangle_count: usize,
    transform: Array<f32>,
    diffuse_share: f64,
    emits: bool,
}

/// A camera; see the header.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Camera {
    position: [f32; 3],
    target: [f32; 3],
    vertical_fov_deg: f32,
}

#[derive(Debug)]
pub(crate) struct Scene(SceneIndicators);

/// The indicators.
type Numbers = [Number; SCHEMA.len()];

/// A mesh whose buffers were looked at.
struct Buffers {
    vertices: Strided<f32, 3>,
    indices: Strided<u32, 3>,
    transform: Option<DAffine3>,
    surface: Surface,
}

impl Buffers {
    fn of(mesh: &Mesh) -> Result<Self, Failure> {
        let transform =
            mesh.transform.read(if mesh.transform.is_none() { 0 } else { 12 }, "the transform")?;
        let transform = <&[f32; 12]>::try_from(transform)
            .ok()
            .map(|columns| DAffine3::from_cols_array(&columns.map(f64::from)));
        let share = mesh.diffuse_share;
        if !(0.0..=1.0).contains(&share) {
            return Err(Failure::invalid(format!("a diffuse share of {share} is not within 0 to 1")));
        }
        Ok(Self {
            vertices: Strided::new(
                mesh.vertices,
                mesh.vertex_stride,
                mesh.vertex_count,
                "the vertex buffer",
            )?,
            indices: Strided::new(mesh.indices, mesh.index_stride, mesh.triangle_count, "the index buffer")?,
            transform,
            surface: Surface { diffuse_share: share, emits: mesh.emits },
        })
    }

    /// The corners in the world. Triangles that name a vertex beyond the buffer or lie at infinity are left
    /// out, as Embree leaves them out.
    fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> {
        let corner = |index: u32| {
            let point = DVec3::from(self.vertices.get(index as usize)?.map(f64::from));
            let point = self.transform.map_or(point, |transform| transform.transform_point3(point));
            point.is_finite().then_some(point)
        };
        (0..self.indices.len()).filter_map(move |triangle| {
            let [a, b, c] = self.indices.get(triangle)?;
            Some([corner(a)?, corner(b)?, corner(c)?])
        })
    }
}

exports! {
    fn tw_scene_new(meshes: Array<Mesh>, count: usize, other_lights: u32; error) -> Option<Box<Scene>> {
        let buffers: Vec<Buffers> =
            meshes.read(count, "the list of meshes")?.iter().map(Buffers::of).collect::<Result<_, _>>()?;
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in buffers.iter().flat_map(Buffers::triangles).flatten() {
            (min, max) = (min.min(corner), max.max(corner));
        }
        if min.x > max.x {
            (min, max) = (DVec3::ZERO, DVec3::ZERO);
        }
        let mut all = Accumulator::new(min, max);
        for mesh in &buffers {
            all.mesh(mesh.surface, mesh.triangles());
        }
        Ok(Scene(all.finish(other_lights)))
    }

    fn tw_scene_free(scene: Scene);

    fn tw_scene_indicators(
        scene: Option<&Scene>, camera: Option<&Camera>,
        numbers: Option<&mut MaybeUninit<Numbers>>; error
    ) -> bool {
        let camera = need(camera, "camera")?;
        let view = View {
            position: DVec3::from(camera.position.map(f64::from)),
            target: DVec3::from(camera.target.map(f64::from)),
            vertical_fov_deg: f64::from(camera.vertical_fov_deg),
        };
        let values = need(scene, "scene")?.0.with_camera(&view).0;
        let named =
            std::array::from_fn(|index| Number { name: Text::of(&NAMES[index]), value: values[index] });
        need(numbers, "room for the indicators")?.write(named);
        Ok(())
    }

    fn tw_spec_scene_indicators(mut spec: Spec) {
        for one in SCHEMA {
            let scale = match one.scale {
                IndicatorScale::Linear => Scale::Linear,
                IndicatorScale::Log => Scale::Log,
            };
            spec.indicator(one.name, one.min, one.max, scale);
        }
    }
}

static NAMES: LazyLock<Vec<CString>> = LazyLock::new(|| SCHEMA.iter().map(|one| c_text(one.name)).collect());

#[cfg(test)]
mod tests {
    use super::*;

    /// With a smaller count callers would have less room than is written.
    #[test]
    fn the_header_has_room_for_all() {
        let header = include_str!("../include/treewright.h");
        let count = format!("enum {{ TW_SCENE_INDICATORS = {} }};", SCHEMA.len());
        assert!(header.contains(&count), "{count}");
    }
}
