//! Two levels by Embree: a native scene for each object, and one of instances over them.
//!
//! Embree takes rays into the objects' spaces itself and returns the number of the instance, which is ours.
//! It numbers triangles within their object, so the number of the object's first triangle is added.

use std::sync::Arc;

use glam::Affine3A;

use super::native::{NativeScene, SceneHandle, commit, failure, new_scene};
use super::{device::Device, ffi};
use crate::geometry::{Hit, Intersector, Packets, Ray, Triangles};
use crate::parameters::{NativeOptions, Update};
use crate::{error::BuildError, instances::Instances};

/// Native Embree scenes under a scene of their instances.
#[derive(Debug)]
pub struct NativeInstances {
    /// The scene of instances. It refers to the objects' scenes.
    top: NativeScene,
    objects: Vec<NativeScene>,
    /// First triangle of each instance's object.
    first: Vec<u32>,
    instances: Arc<Instances>,
    options: NativeOptions,
}

impl NativeInstances {
    /// Builds the objects' scenes, then that of the instances, all with `options`.
    pub(crate) fn build(
        device: &Device,
        triangles: &Arc<Triangles>,
        instances: &Arc<Instances>,
        options: &NativeOptions,
    ) -> Result<Self, BuildError> {
        let objects = instances
            .parts(triangles)
            .map(|part| NativeScene::build(device, &Arc::new(part), options))
            .collect::<Result<Vec<_>, _>>()?;
        let top = place(device, triangles, instances, &objects, options)?;
        let begins =
            |instance: &crate::instances::Instance| instances.objects()[instance.object as usize].start;
        let first = instances.placed().iter().map(begins).collect();
        Ok(Self { top, objects, first, instances: Arc::clone(instances), options: *options })
    }

    /// Updates objects that move, then rebuilds the scene of instances, which refers to their scenes.
    pub(crate) fn update(
        &mut self,
        triangles: &Arc<Triangles>,
        instances: Option<&Arc<Instances>>,
        update: Update,
    ) -> Result<(), BuildError> {
        BuildError::same_count(self.top.triangle_count(), triangles.len())?;
        update.check()?;
        let instances = self.instances.followed_by(instances)?;
        let mut outcome = Ok(());
        for (object, part) in self.objects.iter_mut().zip(instances.parts(triangles)) {
            if !object.rests(&part, update) {
                outcome = outcome.and(object.update(&Arc::new(part), update));
            }
        }
        self.top = place(self.top.device(), triangles, &instances, &self.objects, &self.options)?;
        self.instances = instances;
        outcome
    }

    /// Bytes Embree took during the builds; see [`NativeScene::bytes`].
    pub fn bytes(&self) -> usize {
        self.top.bytes() + self.objects.iter().map(NativeScene::bytes).sum::<usize>()
    }

    #[inline]
    fn numbered(&self, mut hit: Hit) -> Hit {
        hit.triangle += self.first[hit.instance as usize];
        hit
    }
}

fn place(
    device: &Device,
    triangles: &Arc<Triangles>,
    instances: &Instances,
    objects: &[NativeScene],
    options: &NativeOptions,
) -> Result<NativeScene, BuildError> {
    let before = device.bytes_held();
    let scene = new_scene(device, options)?;
    for (number, instance) in instances.placed().iter().enumerate() {
        let object = &objects[instance.object as usize];
        // An instance of nothing has no box that Embree could build with.
        if !instances.objects()[instance.object as usize].is_empty() {
            attach(device, &scene, number as u32, object, &instance.to_world)?;
        }
    }
    commit(device, scene, triangles, options, before)
}

fn attach(
    device: &Device,
    scene: &SceneHandle,
    number: u32,
    object: &NativeScene,
    to_world: &Affine3A,
) -> Result<(), BuildError> {
    // SAFETY: the device is valid.
    let geometry = unsafe { ffi::rtcNewGeometry(device.handle(), ffi::RTCGeometryType::INSTANCE) };
    if geometry.is_null() {
        return Err(failure(device));
    }
    let columns: [f32; 12] = to_world.to_cols_array();
    // SAFETY: geometry and scenes are valid; Embree copies the twelve numbers, holds a reference to the
    // instanced scene, and attaching retains the geometry, so our own reference is released at once.
    unsafe {
        ffi::rtcSetGeometryInstancedScene(geometry, object.scene.0);
        ffi::rtcSetGeometryTransform(
            geometry,
            0,
            ffi::RTCFormat::FLOAT3X4_COLUMN_MAJOR,
            columns.as_ptr().cast(),
        );
        ffi::rtcCommitGeometry(geometry);
        ffi::rtcAttachGeometryByID(scene.0, geometry, number);
        ffi::rtcReleaseGeometry(geometry);
    }
    device.check().map_err(BuildError::from)
}

impl Intersector for NativeInstances {
    #[inline]
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        self.top.closest(ray).map(|hit| self.numbered(hit))
    }

    #[inline]
    fn occluded(&self, ray: &Ray) -> bool {
        self.top.occluded(ray)
    }

    fn closest_each(&self, packets: Packets, rays: &[Ray], hits: &mut [Option<Hit>]) {
        self.top.closest_each(packets, rays, hits);
        for hit in hits {
            *hit = hit.map(|hit| self.numbered(hit));
        }
    }

    fn occluded_each(&self, packets: Packets, rays: &[Ray], occluded: &mut [bool]) {
        self.top.occluded_each(packets, rays, occluded);
    }
}
