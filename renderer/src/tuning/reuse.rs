//! An estimate of the number of frames that a tree serves, from the changes of the geometry: the weight of
//! its build in the objective `auto`.
//!
//! A tree is built or brought along when the geometry changes. The chance of a change has a gamma posterior
//! from the numbers of changes and of frames, in which older ones count ever less. A tree then serves as many
//! frames as lie between two changes.
//!
//! The estimate enters the state as a power of two, which changes only once the estimate has clearly left the
//! last one.

/// The prior: one change in this number of frames.
const PRIOR_FRAMES: f64 = 16.0;
const PRIOR_CHANGES: f64 = 1.0;
/// After a frame the evidence before it counts for this much: of a hundred frames ago a third is left.
const MEMORY: f64 = 0.99;
/// A still that nobody touches grows its tree's service by a frame at a time, to this.
pub const FRAMES_PER_BUILD_MAX: u32 = 1024;
/// The power of two in the state changes when the estimate is this far away, in powers of two.
const HYSTERESIS: f64 = 0.75;

/// The estimate, frame by frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Reuse {
    frames: f64,
    changes: f64,
    /// Frames since the geometry changed last.
    still: f64,
    /// Binary logarithm of the number in the state.
    state_exponent: i32,
}

impl Default for Reuse {
    fn default() -> Self {
        let mut reuse = Self { frames: 0.0, changes: 0.0, still: 0.0, state_exponent: 0 };
        reuse.state_exponent = reuse.exponent().round() as i32;
        reuse
    }
}

impl Reuse {
    /// A frame in which the geometry changed, or did not.
    pub fn frame(&mut self, geometry_changed: bool) {
        self.frames = self.frames * MEMORY + 1.0;
        self.changes = self.changes * MEMORY + f64::from(u8::from(geometry_changed));
        self.still = if geometry_changed { 0.0 } else { self.still + 1.0 };
        let exponent = self.exponent();
        if (exponent - f64::from(self.state_exponent)).abs() > HYSTERESIS {
            self.state_exponent = exponent.round() as i32;
        }
    }

    /// The number of frames that a tree is expected to serve, 1 to [`FRAMES_PER_BUILD_MAX`], and at least
    /// what it has served already (Laplace's rule, without a scale Gott's of 1993).
    pub fn expected(&self) -> f64 {
        let between = (PRIOR_FRAMES + self.frames) / (PRIOR_CHANGES + self.changes);
        between.max(self.still).clamp(1.0, f64::from(FRAMES_PER_BUILD_MAX))
    }

    /// That number in the state: a power of two.
    pub fn frames_per_build(&self) -> u32 {
        1 << self.state_exponent.clamp(0, FRAMES_PER_BUILD_MAX.ilog2() as i32)
    }

    fn exponent(&self) -> f64 {
        self.expected().log2()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(begin: &Reuse, frames: usize, changed: impl Fn(usize) -> bool) -> Reuse {
        let mut reuse = begin.clone();
        (0..frames).for_each(|frame| reuse.frame(changed(frame)));
        reuse
    }

    #[test]
    fn what_is_seen_is_believed() {
        let begin = Reuse::default();
        assert_eq!(begin.frames_per_build(), 16);
        let moving = after(&begin, 200, |_| true);
        assert_eq!(moving.frames_per_build(), 1);
        let now_and_then = after(&begin, 2000, |frame| frame % 8 == 0);
        assert_eq!(now_and_then.frames_per_build(), 8);
        let still = after(&begin, 5000, |_| false);
        assert_eq!(still.frames_per_build(), FRAMES_PER_BUILD_MAX);
    }

    #[test]
    fn rest_and_motion_are_noticed_within_some_dozens_of_frames() {
        let moving = after(&Reuse::default(), 500, |_| true);
        assert!(after(&moving, 70, |_| false).frames_per_build() >= 64);
        let still = after(&Reuse::default(), 5000, |_| false);
        assert_eq!(after(&still, 1, |_| true).frames_per_build(), 64, "one change is one change");
        assert!(after(&still, 60, |_| true).frames_per_build() <= 4);
    }

    #[test]
    fn what_is_told_does_not_flutter() {
        // One change in 11 or 12 frames lies between the powers 8 and 16.
        let mut reuse = after(&Reuse::default(), 3000, |frame| frame % 11 == 0);
        let mut changes = 0;
        for frame in 0..3000 {
            let before = reuse.frames_per_build();
            reuse.frame(frame % 12 == 0);
            changes += usize::from(reuse.frames_per_build() != before);
        }
        assert!(changes <= 1, "{changes} changes of the reports");
    }
}
