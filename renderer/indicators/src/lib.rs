//! The seventeen indicators that describe a scene and a camera to the tuner (paper Table 2).
//!
//! Where the paper leaves room, these are our choices and reasons:
//! - Surface values are divided by the squared diagonal of the scene's box, as the paper says. A triangle's
//!   size is its area so divided, and the variances are taken of those sizes, so that they do not depend on
//!   the unit of length either.
//! - Camera position and target have the range -10 to 10 in the paper, whose scenes are some ten units wide.
//!   We measure from the middle of the scene's box in tenths of its diagonal. A room modelled in metres or
//!   centimetres then gives equal indicators, a camera inside lies within -5 to 5, and one that looks at the
//!   whole scene from outside seldom leaves -10 to 10. Values beyond are kept.
//! - Variances of triangle sizes are in millionths of the squared diagonal (squared, and squared again), on a
//!   logarithmic scale. Over fourteen scenes they lie between 1e-12 and 4e-4 of the paper's unit, so that on
//!   its linear range of 0 to 0.01 all scenes but one would have two equal numbers.
//! - The contents of an instance count as if they stood there themselves: meshes, triangles and areas are
//!   those of the world, so that a scene has equal indicators with instances and flattened.
//! - Light sources are meshes that glow, plus one each for a sky that is not black and for a sun.
//! - The diffuse ratio weighs each surface's share of rough reflection by its area.
//!
//! Numbers of things and lengths span orders of magnitude, so the schema puts them on a logarithmic scale.
//! Sums run in double precision in the order of the triangles: equal scenes give equal bits.
//!
//! This crate knows triangles and nothing of files or renderers, so that every program can describe its scene
//! alike.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::Serialize;

/// The mapping of an indicator's range to 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum IndicatorScale {
    /// In proportion.
    Linear,
    /// By the logarithm of 1 + value - minimum.
    Log,
}

/// An indicator's name and range (paper Table 2).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct IndicatorSpec {
    /// Its key in [`Indicators::values`].
    pub name: &'static str,
    /// Lower end of the range.
    pub min: f64,
    /// Upper end of the range; values beyond occur and are kept.
    pub max: f64,
    /// The mapping of the range.
    pub scale: IndicatorScale,
}

const fn spec(name: &'static str, min: f64, max: f64, scale: IndicatorScale) -> IndicatorSpec {
    IndicatorSpec { name, min, max, scale }
}

/// Squares of millionths in a square of the whole.
const SQUARED_MILLION: f64 = 1e12;

/// All indicators in the order of Table 2.
pub const SCHEMA: [IndicatorSpec; 17] = {
    use IndicatorScale::{Linear, Log};
    [
        spec("mesh_count", 0.0, 1e5, Log),
        spec("triangle_count", 0.0, 1e7, Log),
        spec("light_count", 0.0, 1e5, Log),
        spec("camera_x", -10.0, 10.0, Linear),
        spec("camera_y", -10.0, 10.0, Linear),
        spec("camera_z", -10.0, 10.0, Linear),
        spec("target_x", -10.0, 10.0, Linear),
        spec("target_y", -10.0, 10.0, Linear),
        spec("target_z", -10.0, 10.0, Linear),
        spec("vertical_fov_deg", 0.0, 180.0, Linear),
        spec("diffuse_ratio", 0.0, 1.0, Linear),
        spec("extent", 0.0, 1e5, Log),
        spec("total_area", 0.0, 10.0, Linear),
        spec("light_area", 0.0, 10.0, Linear),
        spec("area_per_mesh", 0.0, 10.0, Linear),
        spec("var_tri_size_mean", 0.0, 1e-2 * SQUARED_MILLION, Log),
        spec("var_tri_size_variance", 0.0, 1e-2 * SQUARED_MILLION * SQUARED_MILLION, Log),
    ]
};

/// The indicators of one frame, in the order of [`SCHEMA`]. All are finite.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Indicators(pub [f64; SCHEMA.len()]);

impl Indicators {
    /// By name, as the tuner wants them.
    pub fn values(&self) -> BTreeMap<String, f64> {
        SCHEMA.iter().zip(self.0).map(|(spec, value)| (spec.name.to_owned(), value)).collect()
    }

    /// One value by name.
    pub fn get(&self, name: &str) -> Option<f64> {
        SCHEMA.iter().position(|spec| spec.name == name).map(|index| self.0[index])
    }
}

/// The part that depends on the scene alone: computed once, used for every frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneIndicators {
    mesh_count: f64,
    triangle_count: f64,
    light_count: f64,
    diffuse_ratio: f64,
    extent: f64,
    total_area: f64,
    light_area: f64,
    area_per_mesh: f64,
    var_tri_size_mean: f64,
    var_tri_size_variance: f64,
    center: DVec3,
}

/// The appearance of a mesh, as far as the indicators need it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Share of the reflection that scatters widely, 0 (mirror, clear glass) to 1 (matt).
    pub diffuse_share: f64,
    /// Whether it glows.
    pub emits: bool,
}

/// A camera, in the scene's own units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where it stands.
    pub position: DVec3,
    /// The point that it looks at.
    pub target: DVec3,
    /// Vertical field of view in degrees.
    pub vertical_fov_deg: f64,
}

/// Goes through the meshes of a scene, one after the other, to [`SceneIndicators`].
#[derive(Clone, Copy, Debug)]
pub struct Accumulator {
    unit_area: f64,
    extent: f64,
    center: DVec3,
    meshes: u64,
    glowing: u64,
    triangles: f64,
    total: f64,
    lit: f64,
    diffuse: f64,
    variances: Moments,
}

impl Accumulator {
    /// For a scene within this box.
    pub fn new(min: DVec3, max: DVec3) -> Self {
        let extent = (max - min).length();
        Self {
            // A scene that is a point has no area either; dividing by 1 keeps its zeros zero.
            unit_area: if extent > 0.0 { extent * extent } else { 1.0 },
            extent,
            center: (min + max) * 0.5,
            meshes: 0,
            glowing: 0,
            triangles: 0.0,
            total: 0.0,
            lit: 0.0,
            diffuse: 0.0,
            variances: Moments::default(),
        }
    }

    /// Adds a mesh as it stands in the world: the corners of its triangles, in a stable order.
    pub fn mesh(&mut self, surface: Surface, triangles: impl IntoIterator<Item = [DVec3; 3]>) {
        let mut sizes = Moments::default();
        for [a, b, c] in triangles {
            sizes.add((b - a).cross(c - a).length() * 0.5 / self.unit_area);
        }
        self.meshes += 1;
        self.triangles += sizes.count;
        let area = sizes.mean * sizes.count;
        self.total += area;
        self.diffuse += area * surface.diffuse_share;
        if surface.emits && sizes.count > 0.0 {
            self.glowing += 1;
            self.lit += area;
        }
        self.variances.add(sizes.variance());
    }

    /// The result. `other_lights` are those that are no mesh: a sky that is not black, a sun, and so on.
    pub fn finish(self, other_lights: u32) -> SceneIndicators {
        let Self { total, variances, .. } = self;
        SceneIndicators {
            mesh_count: self.meshes as f64,
            triangle_count: self.triangles,
            light_count: self.glowing as f64 + f64::from(other_lights),
            diffuse_ratio: if total > 0.0 { self.diffuse / total } else { 1.0 },
            extent: self.extent,
            total_area: total,
            light_area: self.lit,
            area_per_mesh: total / self.meshes.max(1) as f64,
            var_tri_size_mean: variances.mean * SQUARED_MILLION,
            var_tri_size_variance: variances.variance() * SQUARED_MILLION * SQUARED_MILLION,
            center: self.center,
        }
    }
}

impl SceneIndicators {
    /// Adds a camera. Numbers of the camera that are not finite count as 0.
    pub fn with_camera(&self, camera: &View) -> Indicators {
        let tenth = if self.extent > 0.0 { self.extent / 10.0 } else { 1.0 };
        let relative = |point: DVec3| {
            let point = if point.is_finite() { point } else { self.center };
            (point - self.center) / tenth
        };
        let (position, target) = (relative(camera.position), relative(camera.target));
        let fov_deg = camera.vertical_fov_deg;
        Indicators([
            self.mesh_count,
            self.triangle_count,
            self.light_count,
            position.x,
            position.y,
            position.z,
            target.x,
            target.y,
            target.z,
            if fov_deg.is_finite() { fov_deg } else { 0.0 },
            self.diffuse_ratio,
            self.extent,
            self.total_area,
            self.light_area,
            self.area_per_mesh,
            self.var_tri_size_mean,
            self.var_tri_size_variance,
        ])
    }
}

/// Running mean and variance (Welford 1962): no list, no cancellation.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, value: f64) {
        self.count += 1.0;
        let from_mean = value - self.mean;
        self.mean += from_mean / self.count;
        self.squares += from_mean * (value - self.mean);
    }

    /// Of the population: the triangles at hand are all there are.
    fn variance(&self) -> f64 {
        if self.count > 0.0 { self.squares / self.count } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MATT: Surface = Surface { diffuse_share: 1.0, emits: false };

    #[test]
    fn a_scene_without_extent_or_camera_gives_finite_numbers() {
        let mut point = Accumulator::new(DVec3::ZERO, DVec3::ZERO);
        point.mesh(MATT, [[DVec3::ZERO; 3]]);
        point.mesh(Surface { emits: true, ..MATT }, []);
        let view = View { position: DVec3::NAN, target: DVec3::INFINITY, vertical_fov_deg: f64::NAN };
        let indicators = point.finish(0).with_camera(&view);
        assert!(indicators.0.iter().all(|value| value.is_finite()), "{indicators:?}");
        assert_eq!(indicators.get("mesh_count"), Some(2.0));
        assert_eq!(indicators.get("light_count"), Some(0.0), "an empty mesh does not glow");
    }
}
