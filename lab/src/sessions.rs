//! Sums of measured builds and frames of sessions whose geometry changes every few frames.

use serde::{Deserialize, Serialize};
use treewright_renderer::swap;

/// Build and frame of a structure. On disk a pair; nothing for one that cannot be built, since JSON has no
/// infinity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "Option<[f64; 2]>", into = "Option<[f64; 2]>")]
pub struct Times {
    /// Its build, in milliseconds.
    pub build_ms: f64,
    /// A frame with it, in milliseconds.
    pub frame_ms: f64,
}

/// Whose time the build of a better structure takes while a quick one is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Behind {
    /// The frames': it begins when frames have lost what the better structure would have cost more.
    SameCores,
    /// Nobody's: it begins with the first frame, and costs nothing.
    SpareCores,
}

impl From<Option<[f64; 2]>> for Times {
    fn from(pair: Option<[f64; 2]>) -> Self {
        pair.map_or(Self::NONE, |[build_ms, frame_ms]| Self { build_ms, frame_ms })
    }
}

impl From<Times> for Option<[f64; 2]> {
    fn from(Times { build_ms, frame_ms }: Times) -> Self {
        (build_ms.is_finite() && frame_ms.is_finite()).then_some([build_ms, frame_ms])
    }
}

impl Times {
    /// Of a structure that cannot be built.
    pub const NONE: Self = Self { build_ms: f64::INFINITY, frame_ms: f64::INFINITY };

    /// Its build and `frames` frames with it, in milliseconds.
    pub fn serves_ms(self, frames: u32) -> f64 {
        self.build_ms + f64::from(frames) * self.frame_ms
    }

    /// Frames after which `better` would have been the cheaper from the start: 0 at once, `None` never.
    pub fn break_even(self, better: Self) -> Option<f64> {
        let [quick, better] =
            [self, better].map(|Self { build_ms, frame_ms }| swap::Times { build_ms, frame_ms });
        swap::break_even(quick, better)
    }

    /// Milliseconds of `frames` frames of an unknown number: `better` is built on the same cores after
    /// [`Times::break_even`] of them (Karlin, Manasse, Rudolph and Sleator, "Competitive snoopy caching",
    /// 1988). If it builds no faster, this takes at most twice as long as with the number known.
    pub fn swapped_ms(self, better: Self, frames: u32, behind: Behind) -> f64 {
        let Some(break_even) = self.break_even(better) else { return self.serves_ms(frames) };
        if break_even == 0.0 {
            return better.serves_ms(frames);
        }
        let (after, paid_ms) = match behind {
            Behind::SameCores => (break_even.ceil(), better.build_ms),
            Behind::SpareCores => ((better.build_ms / self.frame_ms).ceil(), 0.0),
        };
        let left = f64::from(frames) - after;
        if left <= 0.0 {
            return self.serves_ms(frames);
        }
        self.build_ms + after * self.frame_ms + paid_ms + left * better.frame_ms
    }
}

/// Milliseconds of a session whose geometry changes every `served` frames, by `stretch_ms` between changes.
pub fn session_ms(frames: u32, served: u32, stretch_ms: impl Fn(u32) -> f64) -> f64 {
    let rest = frames % served;
    let whole_ms = if frames < served { 0.0 } else { f64::from(frames / served) * stretch_ms(served) };
    whole_ms + if rest > 0 { stretch_ms(rest) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const QUICK: Times = Times { build_ms: 10.0, frame_ms: 20.0 };
    const GOOD: Times = Times { build_ms: 110.0, frame_ms: 10.0 };

    #[test]
    fn times_on_disk_are_read_as_they_were() {
        let text = serde_json::to_string(&[QUICK, Times::NONE]).expect("they are numbers");
        assert_eq!(text, "[[10.0,20.0],null]");
        let read: [Times; 2] = serde_json::from_str(&text).expect("they are times");
        assert_eq!(read, [QUICK, Times::NONE]);
    }

    #[test]
    fn a_session_is_the_sum_of_its_stretches() {
        let serves = |frames| QUICK.serves_ms(frames);
        assert_eq!(session_ms(8, 4, serves), 2.0 * 90.0);
        assert_eq!(session_ms(10, 4, serves), 2.0 * 90.0 + 50.0);
        assert_eq!(session_ms(3, 4, serves), 70.0);
        assert_eq!(session_ms(8, 4, |_| f64::INFINITY), f64::INFINITY);
    }

    #[test]
    fn the_better_structure_comes_when_the_frames_have_lost_what_it_costs_more() {
        assert_eq!(QUICK.break_even(GOOD), Some(10.0));
        let swapped = |frames, behind| QUICK.swapped_ms(GOOD, frames, behind);
        assert_eq!(swapped(10, Behind::SameCores), 210.0);
        assert_eq!(swapped(12, Behind::SameCores), 210.0 + 110.0 + 20.0);
        // Its build takes as long as five and a half frames.
        assert_eq!(swapped(6, Behind::SpareCores), 130.0);
        assert_eq!(swapped(12, Behind::SpareCores), 130.0 + 60.0);
    }

    #[test]
    fn what_never_pays_is_never_built_and_what_always_does_is_built_at_once() {
        for behind in [Behind::SameCores, Behind::SpareCores] {
            for never in [QUICK, Times::NONE, Times { build_ms: 5.0, frame_ms: 21.0 }] {
                assert_eq!(QUICK.swapped_ms(never, 100, behind), QUICK.serves_ms(100), "{never:?}");
            }
            let always = Times { build_ms: 9.0, frame_ms: 19.0 };
            assert_eq!(QUICK.swapped_ms(always, 100, behind), always.serves_ms(100));
            assert_eq!(Times::NONE.swapped_ms(QUICK, 100, behind), f64::INFINITY);
        }
    }

    proptest! {
        #[test]
        fn a_swap_costs_at_most_twice_what_knowing_costs(
            build_ms in 1.0..1e3f64,
            dearer_ms in 0.0..1e3f64,
            frame_ms in 1.0..1e2f64,
            better_ms in 1.0..1e2f64,
            frames in 1..2000u32,
        ) {
            let quick = Times { build_ms, frame_ms };
            let better = Times { build_ms: build_ms + dearer_ms, frame_ms: better_ms };
            let known = quick.serves_ms(frames).min(better.serves_ms(frames));
            let [same, spare] = [Behind::SameCores, Behind::SpareCores]
                .map(|behind| quick.swapped_ms(better, frames, behind));
            // Frames are whole ones.
            prop_assert!(same <= 2.0 * known + quick.frame_ms + 1e-6, "{same} ms, known {known} ms");
            prop_assert!(spare <= same + quick.frame_ms + 1e-6, "{spare} ms, on the same cores {same} ms");
        }
    }
}
