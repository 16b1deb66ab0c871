//! The pinhole camera.

use glam::Vec3;
use treewright_accel::Ray;

use crate::scene::Camera;

/// A pinhole camera's rays.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    position: Vec3,
    corner: Vec3,
    right: Vec3,
    down: Vec3,
}

impl Lens {
    /// The lens of a camera for a picture of `width` × `height` pixels.
    pub fn new(camera: &Camera, width: u32, height: u32) -> Self {
        let [right, up, forward] = camera.axes();
        let half_height = camera.half_height(width as f32 / height as f32);
        let half_width = half_height * width as f32 / height as f32;
        Self {
            position: camera.position,
            corner: forward - right * half_width + up * half_height,
            right: right * (2.0 * half_width / width as f32),
            down: -up * (2.0 * half_height / height as f32),
        }
    }

    /// The angle that a pixel in the middle of the picture covers, in radians.
    pub fn pixel_angle(&self) -> f32 {
        self.down.length()
    }

    /// The ray through a point of a pixel, given by two numbers in [0, 1).
    #[inline]
    pub fn ray(&self, x: u32, y: u32, [u, v]: [f32; 2]) -> Ray {
        let direction = self.corner + self.right * (x as f32 + u) + self.down * (y as f32 + v);
        Ray { origin: self.position, direction: direction.normalize(), t_min: 0.0, t_max: f32::INFINITY }
    }
}
