//! Objects of a scene that is being assembled, in spaces of their own, and their placements.

use std::ops::Range;

use glam::{Affine3A, Vec3, Vec3A};
use treewright_accel::Instances;
use treewright_accel::limits::{COORDINATE_MAX, INSTANCES_MAX};

use super::{Bounds, limits::PLACED_TRIANGLES_MAX, text::counted};

#[derive(Clone, Debug, Default)]
pub(super) struct Objects {
    ranges: Vec<Range<u32>>,
    boxes: Vec<Bounds>,
    placed: Vec<(u32, Affine3A)>,
    /// First triangle and first vertex of the object that is being added.
    open: Option<(u32, usize)>,
    left_out: usize,
}

impl Objects {
    pub(super) fn is_open(&self) -> bool {
        self.open.is_some()
    }

    pub(super) fn begin(&mut self, triangle: u32, vertex: usize) {
        assert!(self.open.is_none(), "objects do not hold objects");
        self.open = Some((triangle, vertex));
    }

    /// Ends the object before this triangle; its vertices are those added since it began.
    pub(super) fn end(&mut self, triangle: u32, positions: &[Vec3A]) -> u32 {
        let Some((first, vertex)) = self.open.take() else {
            unreachable!("an object is ended after it began");
        };
        let around = |bounds: Bounds, at: &Vec3A| {
            let at = Vec3::from(*at);
            bounds.union(&Bounds { min: at, max: at })
        };
        self.boxes.push(positions[vertex..].iter().fold(Bounds::NOTHING, around));
        self.ranges.push(first..triangle);
        (self.ranges.len() - 1) as u32
    }

    /// Says whether it could be placed.
    pub(super) fn place(&mut self, object: u32, to_world: Affine3A) -> bool {
        let is_placed = can_stand(&self.boxes[object as usize], &to_world);
        if is_placed {
            self.placed.push((object, to_world));
        } else {
            self.left_out += 1;
        }
        is_placed
    }

    pub(super) fn placed_boxes(&self) -> impl Iterator<Item = Bounds> {
        self.placed.iter().map(|(object, to_world)| self.boxes[*object as usize].transformed(to_world))
    }

    /// Moves the placements; objects stay as they are.
    pub(super) fn move_by(&mut self, by: Vec3) {
        self.placed.iter_mut().for_each(|(_, to_world)| to_world.translation += Vec3A::from(by));
    }

    /// Multiplies all lengths by a factor: the objects' own and how far they are moved.
    pub(super) fn multiply(&mut self, factor: f32) {
        for (_, to_world) in &mut self.placed {
            to_world.translation *= factor;
        }
        for one in &mut self.boxes {
            *one = Bounds { min: one.min * factor, max: one.max * factor };
        }
    }

    /// The instances of a scene with `triangles` triangles, or `None` for a scene without objects. Triangles
    /// outside objects are placed where they are, first.
    ///
    /// # Errors
    /// The number of placed triangles, where that or the number of instances is beyond the limits.
    pub(super) fn finish(self, triangles: usize, notes: &mut Vec<String>) -> Result<Option<Instances>, u64> {
        let left_out = "Left out {} instances that are flattened, not finite or too far away.";
        notes.extend(counted(self.left_out, left_out));
        if self.ranges.is_empty() {
            return Ok(None);
        }
        let (mut ranges, mut placed) = (self.ranges, Vec::new());
        let ends = std::iter::once(0).chain(ranges.iter().map(|range| range.end));
        let starts = ranges.iter().map(|range| range.start).chain([triangles as u32]);
        let between: Vec<Range<u32>> = ends.zip(starts).map(|(end, start)| end..start).collect();
        for range in between.into_iter().filter(|range| !range.is_empty()) {
            placed.push((ranges.len() as u32, Affine3A::IDENTITY));
            ranges.push(range);
        }
        placed.extend(self.placed);
        let count = placed.iter().map(|(object, _)| ranges[*object as usize].len() as u64).sum();
        if count > PLACED_TRIANGLES_MAX || placed.len() > INSTANCES_MAX {
            return Err(count);
        }
        let instances = Instances::new(triangles, ranges, placed);
        Ok(Some(instances.expect("ranges and transformations were checked on the way")))
    }
}

/// Whether an object with this box can be placed so: not flattened, nor too far away.
pub(super) fn can_stand(around: &Bounds, to_world: &Affine3A) -> bool {
    let there = around.transformed(to_world);
    let limit = Vec3::splat(COORDINATE_MAX);
    let is_near = there.min.x > there.max.x
        || (there.min.abs().cmple(limit).all() && there.max.abs().cmple(limit).all());
    let is_finite = to_world.is_finite() && to_world.inverse().is_finite();
    is_near && is_finite && to_world.matrix3.determinant() != 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_between_objects_is_placed_as_it_is() {
        let positions = [Vec3A::ZERO, Vec3A::ONE];
        let mut objects = Objects::default();
        // World 0..4, object 4..6, world 6..7, an empty object, object 7..9, world 9..12.
        for range in [4..6, 7..7, 7..9] {
            objects.begin(range.start, 0);
            objects.end(range.end, &positions);
        }
        let at = Affine3A::from_translation(Vec3::X);
        objects.place(2, at);
        objects.place(0, at);
        for wrong in
            [Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0)), Affine3A::from_translation(Vec3::splat(1e16))]
        {
            objects.place(0, wrong);
        }
        objects.place(0, Affine3A::from_translation(Vec3::NAN));
        let mut notes = Vec::new();
        let instances = objects.finish(12, &mut notes).expect("within limits").expect("there are objects");
        let met: Vec<Range<u32>> = (instances.placed().iter())
            .map(|instance| instances.objects()[instance.object as usize].clone())
            .collect();
        assert_eq!(met, [0..4, 6..7, 9..12, 7..9, 4..6]);
        assert!(notes.len() == 1 && notes[0].starts_with("Left out 3 instances"), "{notes:?}");
    }

    #[test]
    fn a_scene_without_objects_has_no_instances() {
        assert!(Objects::default().finish(7, &mut Vec::new()).is_ok_and(|instances| instances.is_none()));
    }

    #[test]
    fn too_many_placed_triangles_are_refused() {
        let mut objects = Objects::default();
        objects.begin(0, 0);
        objects.end(1 << 20, &[]);
        for _ in 0..1025 {
            objects.place(0, Affine3A::IDENTITY);
        }
        assert_eq!(objects.finish(1 << 20, &mut Vec::new()).expect_err("it is refused"), 1025 << 20);
    }
}
