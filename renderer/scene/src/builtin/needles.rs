//! A turning bundle of long thin triangles (paper section 4.3): half as long as the scene's diagonal, at most
//! angles the hard case for boxes aligned to axes.

use super::generator::{Generator, LightAndPath, key};
use super::{generator::Options, hall, palette::polished};
use crate::{SceneError, needles::bundles};

/// Share of the detail that the hall gets.
const HALL_DETAIL: f32 = 0.4;
/// Needles at full detail, two crossing triangles each.
const NEEDLES: usize = 3_000;
/// Share of a round at which it starts.
const START: f32 = 0.1;

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let own = generator.options;
    generator.options = Options { detail: (own.detail * HALL_DETAIL).max(0.001), ..own };
    let hall = hall::build(generator)?;
    generator.options = own;
    let (bounds, needles) = (generator.assembler.bounds(), generator.count(NEEDLES));
    // The cylinder starts across the nave, through its walls.
    let turn = own.time.rem_euclid(1.0) + START;
    let bundles = bundles(&bounds, turn, needles, |low, high| generator.between(low, high));
    let red = generator.material(polished(0.72, 0.3, 0.13, 0.4));
    let grey = generator.material(polished(0.55, 0.6, 0.66, 0.4));
    generator.add_part("red needles", red, &bundles[0])?;
    generator.add_part("grey needles", grey, &bundles[1])?;
    Ok(LightAndPath {
        sky: hall.sky,
        keys: vec![
            key([-21.0, 2.2, 2.6], [2.0, 5.6, -1.4], 60.0),
            key([-12.0, 3.4, -3.4], [4.0, 6.0, 1.0], 60.0),
            key([-3.0, 9.4, 3.6], [8.0, 5.4, -1.0], 62.0),
            key([9.0, 4.0, -3.0], [-4.0, 6.2, 0.6], 62.0),
            key([18.0, 2.4, 2.8], [0.0, 6.4, 0.0], 60.0),
        ],
    })
}
