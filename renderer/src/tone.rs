//! From radiance to colours on a screen: a tone curve that keeps bright places from burning out.
//!
//! AgX of Troy Sobotka, the view that Blender takes since 4.0: colours drawn towards grey a little, and a
//! film-like curve over 16.5 stops, as fitted by Benjamin Wrensch ("Minimal AgX Implementation", 2023) with
//! his "punchy" look. The primaries are Blender's (ITU-R BT.2020). The result goes through the transfer
//! function of sRGB (IEC 61966-2-1).

use glam::{Mat3, Vec3};

use crate::integrator::sampling::luminance;

/// Linear sRGB in the primaries of BT.2020, and back.
const TO_BT2020: Mat3 = Mat3::from_cols(
    Vec3::new(0.6274, 0.0691, 0.0164),
    Vec3::new(0.3293, 0.9195, 0.0880),
    Vec3::new(0.0433, 0.0113, 0.8956),
);
const FROM_BT2020: Mat3 = Mat3::from_cols(
    Vec3::new(1.6605, -0.1246, -0.0182),
    Vec3::new(-0.5876, 1.1329, -0.1006),
    Vec3::new(-0.0728, -0.0083, 1.1187),
);

/// Primaries drawn towards grey before the curve, and most of the way back after it.
const INSET: Mat3 = Mat3::from_cols(
    Vec3::new(0.856_627_17, 0.137_318_97, 0.111_898_21),
    Vec3::new(0.095_121_24, 0.761_242, 0.076_799_42),
    Vec3::new(0.048_251_607, 0.101_439_04, 0.811_302_37),
);
const OUTSET: Mat3 = Mat3::from_cols(
    Vec3::new(1.127_100_6, -0.141_329_76, -0.141_329_76),
    Vec3::new(-0.110_606_64, 1.157_823_7, -0.110_606_64),
    Vec3::new(-0.016_493_939, -0.016_493_939, 1.251_936_4),
);

/// The stops that the curve covers: 10 below and 6.5 above middle grey, as binary logarithms.
const DARKEST: f32 = -12.473_93;
const BRIGHTEST: f32 = 4.026_069;
/// The look: an exponent on what comes out of the curve, and how far it then goes away from grey.
const LOOK_POWER: f32 = 1.35;
const LOOK_SATURATION: f32 = 1.4;
/// Radiance is multiplied by this, so that with the look middle grey is shown as middle grey.
const LOOK_GAIN: f32 = 1.43;

/// The curve on a share of those stops; its results are encoded with an exponent of 2.2.
fn contrast(x: f32) -> f32 {
    const COEFFICIENTS: [f32; 7] = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232];
    COEFFICIENTS.into_iter().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// An exposed radiance as it is shown, each channel encoded from 0 to 1. Infinity is white, NaN black.
pub fn displayed(radiance: Vec3) -> Vec3 {
    let sound = radiance.map(|channel| if channel.is_nan() { 0.0 } else { channel.clamp(0.0, 1e9) });
    let share = (INSET * (TO_BT2020 * sound * LOOK_GAIN)).map(|channel| {
        let stops = channel.max(1e-10).log2();
        ((stops - DARKEST) / (BRIGHTEST - DARKEST)).clamp(0.0, 1.0)
    });
    let looked = share.map(|share| contrast(share).max(0.0).powf(LOOK_POWER));
    let grey = Vec3::splat(luminance(looked));
    let curved = OUTSET * (grey + (looked - grey) * LOOK_SATURATION);
    let linear = FROM_BT2020 * curved.map(|channel| channel.max(0.0).powf(2.2));
    linear.map(|channel| srgb(channel.clamp(0.0, 1.0)))
}

/// A colour as it is, cut off at white and encoded by the transfer function of sRGB. A NaN is black.
pub fn encoded_plainly(radiance: Vec3) -> Vec3 {
    radiance.map(|channel| srgb(if channel.is_nan() { 0.0 } else { channel.clamp(0.0, 1.0) }))
}

fn srgb(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greys_stay_grey_and_rise_from_black_to_white() {
        let steps: Vec<Vec3> =
            (-140..60).map(|step| displayed(Vec3::splat((step as f32 * 0.1).exp2()))).collect();
        for grey in &steps {
            assert!((grey.max_element() - grey.min_element()).abs() < 4e-3, "{grey}");
        }
        let greens: Vec<f32> = steps.iter().map(|grey| grey.y).collect();
        assert!(greens.is_sorted_by(|a, b| *b >= *a - 1e-3));
        assert!(greens[0] < 0.01 && displayed(Vec3::ZERO).max_element() < 0.01);
        assert!(greens[199] > 0.99);
        // Middle grey, 18 % of white, is shown in the middle.
        assert!((displayed(Vec3::splat(0.18)).y - 0.4614).abs() < 5e-3, "{}", displayed(Vec3::splat(0.18)));
        assert!((srgb(0.5) - 0.735_357).abs() < 1e-5, "IEC 61966-2-1");
    }

    #[test]
    fn paint_is_not_pale() {
        // The saturation of a red that is as bright as middle grey is about what plain sRGB shows.
        let red = Vec3::new(0.6, 0.06, 0.05);
        let red = red * (0.18 / luminance(red));
        let saturation = |colour: Vec3| 1.0 - colour.min_element() / colour.max_element();
        let (film, plain) = (displayed(red), encoded_plainly(red));
        assert!(saturation(film) > 0.9 * saturation(plain), "{film} {plain}");
    }

    #[test]
    fn bright_colours_run_into_white_and_keep_their_order() {
        let red = |stops: f32| displayed(Vec3::new(1.0, 0.05, 0.02) * stops.exp2());
        let saturation = |colour: Vec3| 1.0 - colour.min_element() / colour.max_element();
        assert!(saturation(red(-1.0)) > 0.5 && saturation(red(9.0)) < 0.25);
        for stops in -6..8 {
            let colour = red(stops as f32);
            assert!(colour.x >= colour.y && colour.y >= colour.z - 1e-3, "{colour}");
        }
        // Four stops above middle grey there is still something to be seen of the next one.
        let at = |stops: f32| displayed(Vec3::splat(0.18 * stops.exp2())).y;
        assert!(at(5.0) - at(4.0) > 0.02);
    }

    #[test]
    fn what_is_no_radiance_is_some_colour() {
        assert!(displayed(Vec3::INFINITY).min_element() > 0.98);
        assert!(displayed(Vec3::NAN).max_element() < 0.01);
        assert!(displayed(Vec3::splat(-3.0)).max_element() < 0.01);
    }
}
