//! Right answers first: all against native Embree, which tests of this crate hold against brute force.

use treewright_accel::recording::{RaySet, Recording};
use treewright_accel::{Hit, Intersector, Packets};

use crate::contenders::{Built, Maker};

/// One in this many answers may differ: rounding decides about rays that graze an edge.
const GRAZING: usize = 1000;

/// Distance and number of the triangle that a ray meets, both 0 where a shadow ray meets any.
type Answer = Option<(f32, u32)>;

fn answers(intersector: &dyn Intersector, packets: Packets, set: &RaySet) -> Vec<Answer> {
    if set.class.is_shadow() {
        let mut any = vec![false; set.rays.len()];
        intersector.occluded_each(packets, &set.rays, &mut any);
        any.into_iter().map(|any| any.then_some((0.0, 0))).collect()
    } else {
        let mut hits = vec![None; set.rays.len()];
        intersector.closest_each(packets, &set.rays, &mut hits);
        hits.into_iter().map(|hit| hit.map(|hit: Hit| (hit.t, hit.triangle))).collect()
    }
}

/// Whether one answer is a miss or at another distance. Which triangle at one distance is open.
fn differ(this: Answer, that: Answer) -> bool {
    match (this, that) {
        (Some((t, triangle)), Some((other, others))) => {
            // At a glancing angle the distance hangs on the last digits of the test.
            let tolerance = if triangle == others { 1e-2 } else { 1e-4 };
            (t - other).abs() > tolerance * (1.0 + t)
        }
        (this, that) => this.is_some() != that.is_some(),
    }
}

/// Checks every structure in every packing, robust ones against native Embree's robust one.
pub(crate) fn check(recording: &Recording, contenders: &[Built]) -> Result<(), String> {
    for built in contenders {
        let is_reference = |one: &&Built| one.maker == Maker::Native && one.robust == built.robust;
        let reference = contenders.iter().find(is_reference).ok_or("native Embree is missing")?;
        for set in &recording.sets {
            let expected = answers(reference.intersector.as_ref(), Packets::Single, set);
            for packets in Packets::ALL.into_iter().take(if built.packets { Packets::ALL.len() } else { 1 }) {
                let found = answers(built.intersector.as_ref(), packets, set);
                let wrong = expected.iter().zip(&found).filter(|(this, that)| differ(**this, **that)).count();
                if wrong > 1 + set.rays.len() / GRAZING {
                    let (name, class, count) = (built.name, set.class.name(), set.rays.len());
                    return Err(format!(
                        "{name}, {class}, {packets:?}: {wrong} of {count} answers are wrong"
                    ));
                }
            }
        }
    }
    Ok(())
}
