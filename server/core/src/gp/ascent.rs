//! Climbing one coordinate at a time by the signs of a gradient: iRprop (Igel and Hüsken, "Improving the
//! Rprop learning algorithm", 2000). It needs no scale of the gradient, so that one step a lesson is enough
//! and the next goes on where the last one ended.

/// Moves a coordinate up its slope. The step grows while the slope keeps its sign and is halved when it
/// turns; after a turn the coordinate rests once. `step` stays within `range`, and `sign` is that of the last
/// slope, 0 after a turn.
pub(crate) fn ascend(value: &mut f64, step: &mut f64, sign: &mut i8, slope: f64, range: [f64; 2]) {
    assert!(range[0] <= range[1], "steps from {} to {}", range[0], range[1]);
    let now = i8::from(slope > 0.0) - i8::from(slope < 0.0);
    let turned = now * *sign;
    if turned > 0 {
        *step = (1.2 * *step).min(range[1]);
    } else if turned < 0 {
        *step = (0.5 * *step).max(range[0]);
    }
    *sign = if turned < 0 { 0 } else { now };
    *value += f64::from(*sign) * *step;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_peak_is_found_from_either_side() {
        for start in [-7.0, 0.3, 40.0] {
            let (mut value, mut step, mut sign) = (start, 0.3, 0);
            for _ in 0..200 {
                let slope = 2.0 - value;
                ascend(&mut value, &mut step, &mut sign, slope, [0.001, 1.0]);
            }
            assert!((value - 2.0f64).abs() < 0.01, "{value} from {start}");
        }
    }

    #[test]
    fn steps_grow_while_the_slope_keeps_its_sign_and_are_halved_when_it_turns() {
        let (mut value, mut step, mut sign) = (0.0, 0.5, 0);
        let mut after = |slope: f64| {
            ascend(&mut value, &mut step, &mut sign, slope, [0.2, 0.7]);
            (value, step, sign)
        };
        assert_eq!(after(0.0), (0.0, 0.5, 0), "a flat place");
        assert_eq!(after(3.0), (0.5, 0.5, 1));
        assert_eq!(after(2.0), (1.1, 0.6, 1));
        let (value, step, sign) = after(1.0);
        assert!((value - 1.8).abs() < 1e-12, "{value}");
        assert_eq!((step, sign), (0.7, 1), "no longer than 0.7");
        assert_eq!(after(-1.0), (value, 0.35, 0), "a turn: half the step, and a rest");
        assert_eq!(after(-1.0), (value - 0.35, 0.35, -1), "the first step back has the size it had");
        assert_eq!(after(1.0), (value - 0.35, 0.2, 0), "no shorter than 0.2");
    }

    #[test]
    fn a_slope_that_is_no_number_moves_nothing() {
        let (mut value, mut step, mut sign) = (1.0, 0.3, 1);
        ascend(&mut value, &mut step, &mut sign, f64::NAN, [0.01, 1.0]);
        assert_eq!((value, step, sign), (1.0, 0.3, 0));
    }
}
