//! Right answers first: native Embree against brute force, everything else against native Embree.

use std::error::Error;

use treewright_accel::recording::{RaySet, Recording};
use treewright_accel::{BruteForce, Hit, Intersector, Packets};

use crate::contenders::{Built, Maker, REFERENCE};

/// Tests of a triangle that the brute-force check may take for one set of rays.
const BRUTE_FORCE_BUDGET: usize = 40_000_000;

/// One in this many answers may differ: rounding decides about rays that graze an edge.
const GRAZING: usize = 1000;

/// The answers to one set of rays: nearest hits, or for shadow rays whether there is any.
pub(crate) enum Answers {
    Closest(Vec<Option<Hit>>),
    Any(Vec<bool>),
}

impl Answers {
    /// Asks for all of them.
    pub(crate) fn of(intersector: &dyn Intersector, packets: Packets, set: &RaySet) -> Self {
        if set.class.is_shadow() {
            let mut any = vec![false; set.rays.len()];
            intersector.occluded_each(packets, &set.rays, &mut any);
            Self::Any(any)
        } else {
            let mut closest = vec![None; set.rays.len()];
            intersector.closest_each(packets, &set.rays, &mut closest);
            Self::Closest(closest)
        }
    }

    /// Rays that hit something.
    pub(crate) fn hits(&self) -> usize {
        match self {
            Self::Closest(hits) => hits.iter().flatten().count(),
            Self::Any(any) => any.iter().filter(|any| **any).count(),
        }
    }

    /// Rays whose answer is another one: hit against miss, or another distance. Which of several triangles at
    /// one distance is hit is left open.
    pub(crate) fn differing(&self, other: &Self) -> usize {
        match (self, other) {
            (Self::Closest(these), Self::Closest(those)) => {
                these.iter().zip(those).filter(|(this, that)| !same(**this, **that)).count()
            }
            (Self::Any(these), Self::Any(those)) => these.iter().zip(those).filter(|(a, b)| a != b).count(),
            _ => panic!("answers to questions of different kinds"),
        }
    }
}

fn same(this: Option<Hit>, that: Option<Hit>) -> bool {
    match (this, that) {
        (Some(this), Some(that)) => {
            // The distance of a triangle that is met at a glancing angle hangs on the last digits of the
            // test.
            let tolerance = if this.triangle == that.triangle { 1e-2 } else { 1e-4 };
            (this.t - that.t).abs() <= tolerance * (1.0 + this.t)
        }
        (this, that) => this.is_none() && that.is_none(),
    }
}

/// Checks every structure on every set, in every packing it has of its own: robust ones against native
/// Embree's robust one, the others against the reference, whose answers are returned.
pub(crate) fn check(
    name: &str,
    recording: &Recording,
    contenders: &[Built],
) -> Result<Vec<Answers>, Box<dyn Error>> {
    let reference =
        contenders.iter().find(|built| built.name == REFERENCE).ok_or("the reference is missing")?;
    let oracle = BruteForce::new(&recording.triangles);
    let mut expected = Vec::new();
    for set in &recording.sets {
        let answers = Answers::of(reference.intersector.as_ref(), Packets::Single, set);
        let count = (BRUTE_FORCE_BUDGET / recording.triangles.len().max(1)).clamp(1, set.rays.len().max(1));
        let stride = set.rays.len().div_ceil(count).max(1);
        let some = RaySet { class: set.class, rays: set.rays.iter().copied().step_by(stride).collect() };
        let wrong = Answers::of(reference.intersector.as_ref(), Packets::Single, &some)
            .differing(&Answers::of(&oracle, Packets::Single, &some));
        if wrong > 1 + some.rays.len() / GRAZING {
            return Err(format!(
                "{name}, {}: {wrong} of {} answers of {REFERENCE} differ from brute force",
                set.class.name(),
                some.rays.len()
            )
            .into());
        }
        expected.push(answers);
    }
    // Between others rays slip through that robust structures hold, so these are compared with native
    // Embree's.
    let robust = contenders.iter().find(|built| built.robust && built.maker == Maker::Native);
    for built in contenders {
        for (set, expected) in recording.sets.iter().zip(&expected) {
            let held = robust
                .filter(|_| built.robust)
                .map(|native| Answers::of(native.intersector.as_ref(), Packets::Single, set));
            let expected = held.as_ref().unwrap_or(expected);
            for packets in Packets::ALL.into_iter().take(if built.packets { Packets::ALL.len() } else { 1 }) {
                let wrong = Answers::of(built.intersector.as_ref(), packets, set).differing(expected);
                if wrong > 1 + set.rays.len() / GRAZING {
                    return Err(format!(
                        "{name}, {}, {}, {packets:?}: {wrong} of {} answers are wrong",
                        built.name,
                        set.class.name(),
                        set.rays.len()
                    )
                    .into());
                }
            }
        }
    }
    Ok(expected)
}
