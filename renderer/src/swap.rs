//! A quick tree first, and a better one built behind the frames.
//!
//! Nobody knows how many frames a tree will serve when the geometry changes. So a quick tree is built at
//! once. When frames with it have lost as much as the better tree would have cost more, that one is begun by
//! threads of its own, while frames go on with the quick one. The frame after it is ready swaps them. With
//! both trees' times known this takes at most twice as long as with the number of frames known (Karlin,
//! Manasse, Rudolph and Sleator, "Competitive snoopy caching", 1988). They are learnt from swap to swap.

use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use treewright_accel::{BuildChoice, BuildError, Builder, Structure, TreeParameters, Update};
use treewright_scene::Scene;

use crate::film::Film;
use crate::frame::{Renderer, RendererError, milliseconds, worker_pool};
use crate::integrator::View;
use crate::limits::SWAP_THREADS_SHARE;
use crate::scheduling::ThreadTimes;
use crate::shelf::Built;
use crate::space::Choice;

/// Before the first swap a better tree is expected to take this many times the build of the quick one, and
/// its frames this share of the quick one's. The recommended trees of the two objectives took 8 to 13 times,
/// and 0.73 to 0.85, in five built-in scenes on two cores.
const PRIOR_BUILD: f64 = 8.0;
const PRIOR_FRAME: f64 = 0.8;

/// A better tree's frames are compared with the quick one's by this number of each.
const COMPARED_FRAMES: u32 = 8;

/// How a structure is brought to another moment.
const FOLLOWING: Update = Update::partial(Update::REBUILD_THRESHOLD);

/// What was learnt fades by this factor at each change of the geometry, so that no verdict is for ever.
const FADE: f64 = 0.95;

/// Frames with a quick tree after which a better one would have been the cheaper from the start: 0 at once,
/// `None` never. All in milliseconds.
pub fn break_even(quick: Times, better: Times) -> Option<f64> {
    let dearer_ms = better.build_ms - quick.build_ms;
    let sooner_ms = quick.frame_ms - better.frame_ms;
    (sooner_ms > 0.0 && dearer_ms.is_finite()).then(|| (dearer_ms / sooner_ms).max(0.0))
}

/// A build, and a frame with what it built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Times {
    /// The build, in milliseconds.
    pub build_ms: f64,
    /// A frame, in milliseconds.
    pub frame_ms: f64,
}

/// A ratio that is learnt: a geometric mean that begins as if its prior had been seen once.
#[derive(Clone, Copy, Debug)]
struct Ratio {
    prior: f64,
    log_sum: f64,
    weight: f64,
}

impl Ratio {
    fn new(prior: f64) -> Self {
        Self { prior, log_sum: 0.0, weight: 0.0 }
    }

    fn value(&self) -> f64 {
        ((self.prior.ln() + self.log_sum) / (1.0 + self.weight)).exp()
    }

    fn learn(&mut self, ratio: f64) {
        if ratio > 0.0 && ratio.is_finite() {
            self.log_sum += ratio.ln();
            self.weight += 1.0;
        }
    }

    fn fade(&mut self) {
        self.log_sum *= FADE;
        self.weight *= FADE;
    }
}

/// A mean of the first frames.
#[derive(Clone, Copy, Debug, Default)]
struct Frames {
    count: u32,
    sum_ms: f64,
}

impl Frames {
    fn add(&mut self, frame_ms: f64) {
        self.count += 1;
        self.sum_ms += frame_ms;
    }

    fn mean_ms(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum_ms / f64::from(self.count))
    }
}

/// When a better tree is begun, and what its times are expected to be.
#[derive(Clone, Debug)]
struct Rule {
    build: Ratio,
    frame: Ratio,
    /// The build of the quick tree that serves.
    quick_build_ms: f64,
    quick: Frames,
    better: Frames,
}

impl Rule {
    fn new() -> Self {
        let (build, frame) = (Ratio::new(PRIOR_BUILD), Ratio::new(PRIOR_FRAME));
        Self { build, frame, quick_build_ms: 0.0, quick: Frames::default(), better: Frames::default() }
    }

    /// A quick tree was built, because the geometry changed.
    fn begins(&mut self, quick_build_ms: f64) {
        self.build.fade();
        self.frame.fade();
        self.quick_build_ms = quick_build_ms;
        (self.quick, self.better) = (Frames::default(), Frames::default());
    }

    /// Whether frames with the quick tree have lost what a better one would have cost more.
    fn is_due(&self) -> bool {
        let Some(frame_ms) = self.quick.mean_ms() else { return false };
        let quick = Times { build_ms: self.quick_build_ms, frame_ms };
        let better =
            Times { build_ms: self.build.value() * quick.build_ms, frame_ms: self.frame.value() * frame_ms };
        break_even(quick, better).is_some_and(|frames| f64::from(self.quick.count) >= frames)
    }

    fn built(&mut self, build_ms: f64) {
        self.build.learn(build_ms / self.quick_build_ms);
    }

    fn better_frame(&mut self, frame_ms: f64) {
        if self.better.count >= COMPARED_FRAMES {
            return;
        }
        self.better.add(frame_ms);
        if self.better.count == COMPARED_FRAMES
            && let (Some(better_ms), Some(quick_ms)) = (self.better.mean_ms(), self.quick.mean_ms())
        {
            self.frame.learn(better_ms / quick_ms);
        }
    }
}

/// A structure, and the time of its build in milliseconds.
type Delivery = Result<(Structure, f64), BuildError>;

/// A tree on its way.
#[derive(Debug)]
struct Pending {
    choice: Choice,
    built: Receiver<Delivery>,
    /// Whether the geometry is another by now.
    is_late: bool,
}

/// The trees of a renderer that swaps them.
#[derive(Debug)]
pub struct Swapper {
    quick: Choice,
    /// The choice of the structure that serves.
    serving: Option<Choice>,
    /// Its build.
    build_ms: f64,
    pool: rayon::ThreadPool,
    pending: Option<Pending>,
    /// The latest one that could not be built, and why; it is not tried again.
    failed: Option<(BuildChoice, BuildError)>,
    /// What bringing the structure to this moment took, until a frame shows it.
    followed_ms: Option<f64>,
    rule: Rule,
}

/// How the structure of a frame came to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Came {
    /// It was there.
    Kept,
    /// It was built before the frame, in this many milliseconds.
    Built(f64),
    /// It was built behind the frames, in this many milliseconds of all render threads together.
    Swapped(f64),
}

impl Swapper {
    /// Begins with nothing built. A quarter as many threads as render, at least one, build behind, and
    /// Embree's own where the builder is Embree's.
    ///
    /// # Errors
    /// The system gives no threads.
    pub fn new(renderer: &Renderer, quick: Choice) -> Result<Self, RendererError> {
        let pool = worker_pool("swap", (renderer.threads() / SWAP_THREADS_SHARE).max(1))?;
        Ok(Self {
            quick,
            serving: None,
            build_ms: 0.0,
            pool,
            pending: None,
            failed: None,
            followed_ms: None,
            rule: Rule::new(),
        })
    }

    /// The choice of the structure that serves; it is the renderer's.
    pub fn serving(&self) -> Option<&Choice> {
        self.serving.as_ref()
    }

    /// The build of the structure that serves, in milliseconds of all render threads together.
    pub fn build_ms(&self) -> f64 {
        self.build_ms
    }

    /// Why a choice could not be built behind, if that was tried last.
    pub fn failure(&self, choice: &Choice) -> Option<&BuildError> {
        self.failed.as_ref().filter(|(failed, _)| *failed == choice.build).map(|(_, error)| error)
    }

    /// Whether a tree is being built behind: frames are slower meanwhile.
    pub fn is_building(&self) -> bool {
        self.pending.is_some()
    }

    /// The geometry changed, or a trial has built a structure of its own: nothing serves any more.
    pub fn begin_again(&mut self) {
        (self.serving, self.followed_ms) = (None, None);
        if let Some(pending) = &mut self.pending {
            pending.is_late = true;
        }
    }

    /// Moves on to another moment. Where instances move, the structure that serves is brought along, and so
    /// is one on its way; else nothing serves any more.
    pub fn move_to(&mut self, renderer: &mut Renderer, scene: &Arc<Scene>) {
        if let Some(serving) = &self.serving
            && scene.instances.is_some()
            && let Ok(followed_ms) = renderer.animate(Arc::clone(scene), &serving.build, FOLLOWING)
        {
            self.followed_ms = Some(followed_ms);
            return;
        }
        renderer.set_scene(Arc::clone(scene));
        self.begin_again();
    }

    /// Before a frame: builds the quick tree if there is none, swaps in what is ready, and begins `better` if
    /// that is due.
    ///
    /// # Errors
    /// The quick tree cannot be built.
    pub fn begin_frame(&mut self, renderer: &mut Renderer, better: &Choice) -> Result<Came, BuildError> {
        let swapped = self.take_ready(renderer);
        let Some(serving) = &mut self.serving else {
            let build_ms = renderer.rebuild(&self.quick.build)?;
            (self.serving, self.build_ms) = (Some(self.quick), build_ms);
            self.rule.begins(build_ms);
            return Ok(Came::Built(build_ms));
        };
        if serving.build == better.build {
            *serving = *better;
        } else if self.pending.is_none() && self.failure(better).is_none() && self.rule.is_due() {
            self.begin(renderer, better);
        }
        let followed = self.followed_ms.take().map(Came::Built);
        Ok(swapped.map(Came::Swapped).or(followed).unwrap_or(Came::Kept))
    }

    /// Renders one sample a pixel; returns the time in milliseconds. `None` before the first structure.
    pub fn render(&mut self, renderer: &Renderer, view: &View, film: &mut Film) -> Option<f64> {
        let serving = self.serving.as_ref()?;
        let (render_ms, _) = renderer.render(view, &serving.render, film)?;
        // A build behind slows the frames down that it runs beside.
        if self.pending.is_none() {
            if serving.build == self.quick.build {
                self.rule.quick.add(render_ms);
            } else {
                self.rule.better_frame(render_ms);
            }
        }
        Some(render_ms)
    }

    /// Waits for the tree on its way, which is dropped.
    pub fn wait(&mut self) {
        if let Some(pending) = self.pending.take()
            && let Ok(Ok((_, build_ms))) = pending.built.recv()
        {
            self.rule.built(build_ms);
        }
    }

    fn begin(&mut self, renderer: &Renderer, better: &Choice) {
        let (sender, built) = channel();
        let job = renderer.build_job(&better.build);
        // Embree builds with all threads of its device.
        let share = match better.build {
            BuildChoice::Tree(TreeParameters { builder: Builder::Ploc, .. }) => {
                self.pool.current_num_threads() as f64 / renderer.threads() as f64
            }
            _ => 1.0,
        };
        self.pool.spawn(move || {
            let begin = Instant::now();
            let built = job();
            // Nobody waits for it where the flight has ended.
            let _ = sender.send(built.map(|structure| (structure, share * milliseconds(begin))));
        });
        self.pending = Some(Pending { choice: *better, built, is_late: false });
    }

    /// Swaps in the tree that is ready, if it is not late.
    fn take_ready(&mut self, renderer: &mut Renderer) -> Option<f64> {
        let pending = self.pending.as_ref()?;
        let built = match pending.built.try_recv() {
            Err(TryRecvError::Empty) => return None,
            Err(TryRecvError::Disconnected) => None,
            Ok(built) => Some(built),
        };
        let Pending { choice, is_late, .. } = self.pending.take()?;
        let (structure, build_ms) = match built? {
            Ok(built) => built,
            Err(error) => {
                self.failed = Some((choice.build, error));
                return None;
            }
        };
        self.rule.built(build_ms);
        if is_late {
            return None;
        }
        let (build, threads, bytes) = (choice.build, ThreadTimes::default(), OnceLock::new());
        renderer.adopt(Built { structure, choice: build, build_ms, threads, trials: 1, bytes });
        if renderer.scene().instances.is_some() && renderer.catch_up(FOLLOWING).is_err() {
            self.serving = None;
            return None;
        }
        (self.serving, self.build_ms) = (Some(choice), build_ms);
        Some(build_ms)
    }
}

impl Drop for Swapper {
    /// A process must not end while Embree builds.
    fn drop(&mut self) {
        self.wait();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use treewright_scene::builtin;

    use super::*;
    use crate::space::{Premises, Preset, TuningSpace};

    /// Milliseconds of `frames` frames by the rule, from now on, with the build behind on the frames' time.
    fn ruled_ms(rule: &mut Rule, quick: Times, better: Times, frames: u32) -> f64 {
        rule.begins(quick.build_ms);
        let (mut spent_ms, mut is_better) = (quick.build_ms, false);
        for _ in 0..frames {
            if !is_better && rule.is_due() {
                is_better = true;
                spent_ms += better.build_ms;
                rule.built(better.build_ms);
            }
            if is_better {
                spent_ms += better.frame_ms;
                rule.better_frame(better.frame_ms);
            } else {
                spent_ms += quick.frame_ms;
                rule.quick.add(quick.frame_ms);
            }
        }
        spent_ms
    }

    fn times(build_ms: f64, frame_ms: f64) -> Times {
        Times { build_ms, frame_ms }
    }

    #[test]
    fn the_break_even_is_where_both_have_cost_as_much() {
        let (quick, better) = (times(10.0, 20.0), times(110.0, 10.0));
        assert_eq!(break_even(quick, better), Some(10.0));
        assert_eq!(break_even(quick, times(5.0, 10.0)), Some(0.0), "better at once");
        assert_eq!(break_even(quick, times(110.0, 20.0)), None);
        assert_eq!(break_even(quick, times(f64::INFINITY, 10.0)), None);
    }

    #[test]
    fn a_tree_that_is_not_better_is_left_and_tried_again_later() {
        let mut rule = Rule::new();
        let (quick, worse) = (times(10.0, 10.0), times(80.0, 12.0));
        let builds = |rule: &mut Rule, stretches: u32| {
            let alone_ms = quick.build_ms + 200.0 * quick.frame_ms;
            (0..stretches).filter(|_| ruled_ms(rule, quick, worse, 200) > alone_ms).count()
        };
        let first = builds(&mut rule, 100);
        assert!((1..20).contains(&first), "{first} of the first hundred");
        let later = builds(&mut rule, 300);
        assert!((1..30).contains(&later), "{later} of three hundred");
    }

    proptest! {
        #[test]
        fn once_learnt_it_costs_at_most_twice_what_knowing_costs(
            build_ms in 1.0..50.0, frame_ms in 1.0..200.0,
            longer in 1.0..30.0, sooner in 0.2..1.0, frames in 1u32..2000,
        ) {
            let (quick, better) = (times(build_ms, frame_ms), times(build_ms * longer, frame_ms * sooner));
            let mut rule = Rule::new();
            rule.build = Ratio::new(longer);
            rule.frame = Ratio::new(sooner);
            let ruled_ms = ruled_ms(&mut rule, quick, better, frames);
            let alone_ms = |of: Times| of.build_ms + f64::from(frames) * of.frame_ms;
            // The last frame before the swap may have been one too many.
            let most_ms = 2.0 * alone_ms(quick).min(alone_ms(better)) + frame_ms;
            prop_assert!(ruled_ms <= most_ms, "{ruled_ms} of {most_ms}");
        }
    }

    #[test]
    fn frames_are_equal_before_and_after_a_swap() {
        let scene = Arc::new(
            builtin::build("gallery", &builtin::Options { detail: 0.02, ..Default::default() })
                .expect("it is built in"),
        );
        let mut renderer = Renderer::new(Arc::clone(&scene), 0).expect("Embree starts");
        let space = |builds_each_frame| {
            TuningSpace::new(Preset::Full, &Premises { builds_each_frame, ..Premises::all() })
        };
        let (quick, good) = (space(true).default_choice(), space(false).default_choice());
        assert_ne!(quick.build, good.build);
        let view = View { camera: scene.cameras[0], seed: 1, bounces: 2 };
        let mut swapper = Swapper::new(&renderer, quick).expect("there are threads");
        let mut pictures = Vec::new();
        let mut picture = |swapper: &mut Swapper, renderer: &mut Renderer| {
            let came = swapper.begin_frame(renderer, &good).expect("it can be built");
            let mut film = Film::new([16, 12]);
            swapper.render(renderer, &view, &mut film).expect("there is a structure");
            pictures.push(film.picture());
            came
        };
        assert!(matches!(picture(&mut swapper, &mut renderer), Came::Built(_)));
        let mut frames = 0;
        while swapper.serving() != Some(&good) {
            let came = picture(&mut swapper, &mut renderer);
            assert!(matches!(came, Came::Kept | Came::Swapped(_)), "{came:?}");
            frames += 1;
            assert!(frames < 100_000, "it is never swapped in");
        }
        assert_eq!(picture(&mut swapper, &mut renderer), Came::Kept);

        // One that is late is not swapped in.
        swapper.begin_again();
        assert!(matches!(picture(&mut swapper, &mut renderer), Came::Built(_)));
        swapper.begin(&renderer, &good);
        swapper.begin_again();
        picture(&mut swapper, &mut renderer);
        while swapper.is_building() && frames < 200_000 {
            picture(&mut swapper, &mut renderer);
            frames += 1;
        }
        assert_eq!(swapper.serving(), Some(&quick));
        assert!(pictures.windows(2).all(|pair| pair[0] == pair[1]), "trees show the scene alike");
    }
}
