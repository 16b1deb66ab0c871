//! The structures of a flight, from frame to frame.

use std::sync::Arc;

use treewright_accel::{BuildError, Structure, Update};
use treewright_client::{Configuration, Outcome};
use treewright_renderer::frame::{FrameTimes, Renderer};
use treewright_renderer::scheduling::{ThreadTimes, of_process};
use treewright_renderer::space::{Choice, Preset, TuningSpace};
use treewright_renderer::swap::{Came, Swapper};
use treewright_renderer::{film::Film, follow::Wear, integrator::View, tuning::search::not_built};
use treewright_scene::Scene;

use crate::error::Result;

/// How a flight goes.
pub(super) struct Setting {
    /// Its first view.
    pub(super) view: View,
    /// Pixels across and down.
    pub(super) size: [u32; 2],
    /// Whether each frame builds.
    pub(super) each_frame: bool,
    /// Whether structures are swapped.
    pub(super) swaps: bool,
    /// Whether frames are shown with the baseline as well.
    pub(super) compares: bool,
}

/// A frame as it was shown.
pub(super) struct Shown {
    pub(super) outcome: Outcome,
    pub(super) times: Option<FrameTimes>,
    pub(super) rebuilt: bool,
    pub(super) swapped: bool,
    pub(super) stands_in: bool,
}

impl Shown {
    /// With a structure of the answer, unless that could not be built.
    fn of_answer(outcome: Outcome, times: Option<FrameTimes>, rebuilt: bool) -> Self {
        Self { outcome, times, rebuilt, swapped: false, stands_in: false }
    }
}

/// The state that moves on from frame to frame.
pub(super) struct Flight {
    renderer: Renderer,
    space: TuningSpace,
    pub(super) view: View,
    film: Film,
    each_frame: bool,
    /// The scene as it is from this frame on, if it moved. After a failed build it waits for the next one.
    pub(super) moment: Option<Arc<Scene>>,
    /// Whether there was such a moment when this frame began.
    pub(super) moved: bool,
    kept: Option<Kept>,
    /// The age and decay of its structure.
    wear: Wear,
    /// The structures, where they are swapped.
    swapper: Option<Swapper>,
    /// The choice that frames are compared with.
    baseline: Choice,
    /// Its structure, where they are, and how long that took to build.
    compared: Option<(Structure, f64)>,
}

/// The choice of the kept structure, and the time of its build.
struct Kept {
    choice: Choice,
    build_ms: f64,
    /// Processor times of threads for it.
    threads: ThreadTimes,
}

impl Flight {
    /// Builds and renders with the baseline once, which warms threads, caches and clocks.
    pub(super) fn new(
        renderer: Renderer,
        space: TuningSpace,
        baseline: Choice,
        how: &Setting,
    ) -> Result<Self> {
        let Setting { view, size, each_frame, .. } = *how;
        let mut film = Film::new(size);
        let built = renderer.build(&baseline.build)?;
        renderer.render_with(&built.0, &view, &baseline.render, &mut film);
        let swapper = if how.swaps {
            let quick = space.quick_choice();
            Some(Swapper::new(&renderer, quick)?)
        } else {
            None
        };
        let compared = how.compares.then_some(built);
        Ok(Self {
            renderer,
            space,
            view,
            film,
            each_frame,
            moment: None,
            moved: false,
            kept: None,
            wear: Wear::default(),
            swapper,
            baseline,
            compared,
        })
    }

    /// Builds if needed and renders. After a failed build the frame is shown with the structure before it. A
    /// trial is built before its frame also where structures are swapped.
    pub(super) fn frame(&mut self, configuration: &Configuration, is_trial: bool) -> Shown {
        if self.swapper.is_some() && !is_trial {
            return self.swapped_frame(configuration);
        }
        if let Some(swapper) = &mut self.swapper {
            // A build behind would slow it down.
            swapper.wait();
            swapper.begin_again();
        }
        let rebuilt = self.make_ready(configuration);
        let rebuilt = match rebuilt {
            Ok(rebuilt) => rebuilt,
            Err(outcome) => {
                self.render();
                return Shown::of_answer(outcome, None, false);
            }
        };
        match self.render() {
            Some(times) => Shown::of_answer(Outcome::Ok, Some(times), rebuilt),
            None => Shown::of_answer(Outcome::failed("no structure was built"), None, rebuilt),
        }
    }

    /// A frame with whatever structure is there, while that of the answer is built behind.
    fn swapped_frame(&mut self, configuration: &Configuration) -> Shown {
        let failed = |outcome| Shown::of_answer(outcome, None, false);
        let choice = match self.space.choice(configuration) {
            Ok(choice) => choice,
            Err(error) => return failed(Outcome::failed(error.to_string())),
        };
        // What was kept for trials is of another moment, or not the renderer's any more.
        self.kept = None;
        let Some(swapper) = &mut self.swapper else { return failed(Outcome::failed("nothing is swapped")) };
        if let Some(scene) = self.moment.take() {
            swapper.move_to(&mut self.renderer, &scene);
        }
        let came = match swapper.begin_frame(&mut self.renderer, &choice) {
            Ok(came) => came,
            // The quick tree is not the answer's.
            Err(error) => return Shown { stands_in: true, ..failed(not_built(&error)) },
        };
        let failure = swapper.failure(&choice).map(not_built);
        self.film.clear();
        let (renderer, view, film) = (&self.renderer, &self.view, &mut self.film);
        let (rendered, render) = renderer.watching_threads(|| swapper.render(renderer, view, film));
        let Some(render_ms) = rendered else { return failed(Outcome::failed("no structure was built")) };
        if let Some(outcome) = failure {
            return failed(outcome);
        }
        let is_own = swapper.serving().is_some_and(|serving| *serving == choice) && !swapper.is_building();
        let build_ms = match came {
            Came::Built(build_ms) => build_ms,
            Came::Kept | Came::Swapped(_) => swapper.build_ms(),
        };
        let render = render.shared_by(renderer.threads(), render_ms);
        let times = FrameTimes {
            render_cpu_ms: Some(render.cpu_ms),
            render_delay_ms: render.delay_ms,
            ..FrameTimes::of(build_ms, render_ms)
        };
        Shown {
            outcome: Outcome::Ok,
            times: Some(times),
            rebuilt: matches!(came, Came::Built(_)),
            swapped: matches!(came, Came::Swapped(_)),
            stands_in: !is_own,
        }
    }

    /// Builds unless the kept structure serves, and returns whether it did.
    fn make_ready(&mut self, configuration: &Configuration) -> Result<bool, Outcome> {
        let choice = self.space.choice(configuration).map_err(|error| Outcome::failed(error.to_string()))?;
        if let Some(kept) = &mut self.kept
            && kept.choice.build == choice.build
            && !self.each_frame
            && self.moment.is_none()
        {
            kept.choice = choice;
            return Ok(false);
        }
        self.build(choice)?;
        Ok(true)
    }

    fn build(&mut self, choice: Choice) -> Result<(), Outcome> {
        let moment = self.moment.take();
        let (built, threads) = of_process(|| match &moment {
            Some(scene) => self.follow(Arc::clone(scene), &choice),
            None => self.renderer.rebuild(&choice.build),
        });
        let build_ms = built.map_err(|error| {
            // Else a scene that rests from now on would be shown as it was before.
            self.moment = moment;
            not_built(&error)
        })?;
        self.kept = Some(Kept { choice, build_ms, threads });
        Ok(())
    }

    /// Brings the structure to another moment; one of another choice is rebuilt first, untimed.
    fn follow(&mut self, scene: Arc<Scene>, choice: &Choice) -> Result<f64, BuildError> {
        let mut update = match self.space.preset() {
            Preset::Full => Update::partial(Update::REBUILD_THRESHOLD),
            _ => choice.update,
        };
        let stranger = self.kept.as_ref().is_none_or(|kept| kept.choice.build != choice.build);
        if stranger {
            self.wear = Wear::default();
        }
        if self.wear.is_over(choice.period) {
            update = Update::Rebuild;
        }
        if stranger && update != Update::Rebuild {
            self.renderer.rebuild(&choice.build)?;
        }
        self.renderer.animate(scene, &choice.build, update)
    }

    /// A frame with the kept structure. `None` before the first build that succeeds.
    fn render(&mut self) -> Option<FrameTimes> {
        let Kept { choice, build_ms, threads } = *self.kept.as_ref()?;
        self.film.clear();
        let (renderer, view, film) = (&self.renderer, &self.view, &mut self.film);
        let (rendered, render) = renderer.watching_threads(|| renderer.render(view, &choice.render, film));
        let render_ms = rendered?.0;
        self.wear.rendered(render_ms);
        Some(FrameTimes::of(build_ms, render_ms).with_threads(renderer.threads(), threads, render))
    }

    /// A frame of this view with the baseline.
    pub(super) fn default_frame(&mut self) -> Option<FrameTimes> {
        let (structure, build_ms) = self.compared.as_mut()?;
        if (self.each_frame || self.moved)
            && let Ok(built) = self.renderer.build(&self.baseline.build)
        {
            (*structure, *build_ms) = built;
        }
        self.film.clear();
        let (render_ms, _) =
            self.renderer.render_with(structure, &self.view, &self.baseline.render, &mut self.film);
        Some(FrameTimes::of(*build_ms, render_ms))
    }
}

#[cfg(test)]
mod tests {
    use treewright_accel::{BuildChoice, TreeParameters};
    use treewright_renderer::tuning::verdict;
    use treewright_scene::builtin::{self, Options};

    use super::*;

    #[test]
    fn a_moment_waits_for_a_build_that_succeeds() {
        let at = |time| {
            let options = Options { detail: 0.05, time, ..Options::default() };
            Arc::new(builtin::build("needles", &options).expect("it is built in"))
        };
        let (scene, moment) = (at(0.0), at(0.4));
        let renderer = Renderer::new(Arc::clone(&scene), 1).expect("Embree starts");
        let view = View { camera: scene.cameras[0], seed: 1, bounces: 3 };
        let how = Setting { view, size: [8, 6], each_frame: false, swaps: false, compares: false };
        let space = TuningSpace::paper();
        let good = Choice { update: Update::Refit, ..verdict::baseline(space.preset()).choice };
        let mut flight = Flight::new(renderer, space, good, &how).expect("it can be built");
        flight.build(good).expect("it can be built");

        flight.moment = Some(Arc::clone(&moment));
        let parameters = TreeParameters { branching_factor: 3, ..TreeParameters::default() };
        let bad = Choice { build: BuildChoice::Tree(parameters), ..good };
        assert!(matches!(flight.build(bad), Err(Outcome::Failed { .. })));
        assert!(flight.moment.is_some(), "the structure is that of the moment before");
        flight.build(good).expect("it can be built");
        assert!(flight.moment.is_none() && Arc::ptr_eq(flight.renderer.scene(), &moment));
    }
}
