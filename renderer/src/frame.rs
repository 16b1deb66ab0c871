//! One frame: build the acceleration structure if there is need, render one sample a pixel, time both.
//!
//! Two ways to use it (paper section 7). Progressive: build once, render while nothing moves, the samples
//! add up. Real-time: build for each frame. Build and render are timed apart and reported raw.

use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use treewright_accel::{
    BuildChoice, BuildError, Device, DeviceError, Intersector, Structure, Update, Visitor, build,
    build_instanced,
};

use crate::bias::{Bias, Squares};
use crate::film::{Film, Picture};
use crate::integrator::{Counts, Learnt, Needs, Prepared, View, learn, render_sample};
use crate::light_sampling::{LearningTimes, LightSampling};
use crate::noise::{FrameNoise, HALF_SAMPLES, WEIGHT_SAMPLES, Weights};
use crate::scheduling::{RunQueueDelay, ThreadTimes, of_process, thread_cpu_ms, undelayed_ms};
use crate::shelf::{Built, Shelf};
use crate::{limits::TRIALS_PER_BUILD_MAX, render_options::RenderOptions, statistics::Summary};
use treewright_scene::Scene;

/// Makes the seeds of a second look others.
const SECOND_LOOK: u64 = 0x5bf0_3635;

/// The times of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameTimes {
    /// Building the structure; 0 when it was kept.
    pub build_ms: f64,
    /// Rendering one sample a pixel.
    pub render_ms: f64,
    /// Processor time of all threads during the build; absent where it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub build_cpu_ms: Option<f64>,
    /// Processor time of the render threads during the frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub render_cpu_ms: Option<f64>,
    /// Time that all threads together waited for a processor during the build, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub build_delay_ms: Option<f64>,
    /// Time that the render threads together waited for a processor during the frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub render_delay_ms: Option<f64>,
    /// The number of trials that the structure had served before; absent if it was built for this one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trials_before: Option<u32>,
    /// Frames whose median is the rendering time, if not the requested ones; 0 for earlier trials' mean.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames: Option<u32>,
    /// Time of frames in the second half of an episode over that in its first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trend: Option<f64>,
    /// Memory of the structure in bytes; absent where it was not looked at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub structure_bytes: Option<usize>,
    /// Its noise; absent where only time counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<FrameNoise>,
}

impl FrameTimes {
    /// By the clock on the wall alone.
    pub fn of(build_ms: f64, render_ms: f64) -> Self {
        Self { build_ms, render_ms, ..Self::default() }
    }

    /// Adds the processor times of the `threads` threads that shared each of the two.
    #[must_use]
    pub fn with_threads(self, threads: usize, build: ThreadTimes, render: ThreadTimes) -> Self {
        let build = build.shared_by(threads, self.build_ms);
        let render = render.shared_by(threads, self.render_ms);
        Self {
            build_cpu_ms: Some(build.cpu_ms),
            render_cpu_ms: Some(render.cpu_ms),
            build_delay_ms: build.delay_ms,
            render_delay_ms: render.delay_ms,
            ..self
        }
    }

    /// The wall-clock times without waiting for processors ([`undelayed_ms`]), where that is known.
    #[must_use]
    pub fn undelayed(self) -> Self {
        let undelayed = |wall_ms: f64, cpu_ms: Option<f64>, delay_ms: Option<f64>| {
            cpu_ms.zip(delay_ms).map_or(wall_ms, |(cpu_ms, delay_ms)| undelayed_ms(wall_ms, cpu_ms, delay_ms))
        };
        let build_ms = undelayed(self.build_ms, self.build_cpu_ms, self.build_delay_ms);
        let render_ms = undelayed(self.render_ms, self.render_cpu_ms, self.render_delay_ms);
        Self { noise: self.noise, ..Self::of(build_ms, render_ms) }
    }
}

/// The times of a structure that is ready for a trial.
#[derive(Clone, Copy, Debug)]
pub struct Ready {
    /// Building it.
    pub build_ms: f64,
    /// The processor times of the process's threads meanwhile.
    pub threads: ThreadTimes,
    /// The number of trials that it had served before; 0 if it was built for this one.
    pub trials_before: u32,
}

impl Built {
    /// Whether it is of this choice and may serve another trial, which then counts.
    pub(crate) fn serves_again(&mut self, choice: &BuildChoice) -> bool {
        let serves = self.choice == *choice && self.trials < TRIALS_PER_BUILD_MAX;
        self.trials += u32::from(serves);
        serves
    }

    pub(crate) fn bytes(&self) -> usize {
        *self.bytes.get_or_init(|| self.structure.statistics().bytes)
    }

    fn ready(&self) -> Ready {
        Ready { build_ms: self.build_ms, threads: self.threads, trials_before: self.trials - 1 }
    }
}

/// Why there is no renderer.
#[derive(Debug, thiserror::Error)]
pub enum RendererError {
    /// Embree does not start.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The system gives no threads.
    #[error("{threads} render threads cannot be started: {source}; ask for fewer with --threads")]
    Threads {
        /// The number that was asked for; 0 means one a core.
        threads: usize,
        /// The system's error.
        source: rayon::ThreadPoolBuildError,
    },
}

/// Render threads, the Embree device, a scene, and the structure that was built last.
#[derive(Debug)]
pub struct Renderer {
    device: Device,
    pool: rayon::ThreadPool,
    /// The run-queue delays of the pool's threads; none where the system does not report them.
    delays: Vec<RunQueueDelay>,
    pub(crate) prepared: Arc<Prepared>,
    pub(crate) moments: Vec<Arc<Prepared>>,
    /// The structure that frames are rendered with.
    current: Option<Built>,
    shelf: Shelf,
    studied: Option<Studied>,
}

/// A view that noise is measured in.
#[derive(Debug)]
struct Studied {
    view: View,
    size: [u32; 2],
    learning: LearningTimes,
    weights: Weights,
}

impl Renderer {
    /// A renderer of a scene with this many threads for building and rendering; 0 for one a core.
    pub fn new(scene: Arc<Scene>, threads: usize) -> Result<Self, RendererError> {
        let device = Device::open(threads)?;
        let pool = worker_pool("render", threads)?;
        let prepared = Arc::new(pool.install(|| Prepared::new(scene)));
        let delays: Option<Vec<_>> =
            pool.broadcast(|_| RunQueueDelay::of_this_thread()).into_iter().collect();
        let delays = delays.unwrap_or_default();
        Ok(Self {
            device,
            pool,
            delays,
            prepared,
            moments: Vec::new(),
            current: None,
            shelf: Shelf::default(),
            studied: None,
        })
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.prepared.scene
    }

    /// Looks for light in another way from now on. What needs to be learnt is, by [`Self::learn_light`].
    pub fn set_light_sampling(&mut self, how: LightSampling) {
        if self.prepared.light_sampling() != how {
            Arc::make_mut(&mut self.prepared).set_light_sampling(how);
        }
    }

    /// Renders small frames of a view and learns from them for light sampling. `None` without a structure.
    pub fn learn_light(&mut self, view: &View, size: [u32; 2]) -> Option<LearningTimes> {
        let kept = self.current.take()?;
        let learning = self.learn_light_with(&kept.structure, view, size);
        self.current = Some(kept);
        Some(learning)
    }

    /// Learns light with another structure. What is learnt does not depend on how light is looked for now.
    pub fn learn_light_with(&mut self, structure: &Structure, view: &View, size: [u32; 2]) -> LearningTimes {
        let how = self.prepared.light_sampling();
        self.set_light_sampling(LightSampling::default());
        let pilot = Pilot { prepared: &self.prepared, view, size };
        let learnt = self.pool.install(|| structure.visit(pilot));
        let times = learnt.times;
        Arc::make_mut(&mut self.prepared).take_over(learnt);
        self.set_light_sampling(how);
        times
    }

    /// Prepares the measurement of noise in a view; returns what learning took. `None` without a structure.
    pub fn study_view(
        &mut self,
        view: &View,
        options: &RenderOptions,
        size: [u32; 2],
    ) -> Option<LearningTimes> {
        let known = self.studied.as_ref().filter(|known| known.view == *view && known.size == size);
        if let Some(known) = known {
            return Some(known.learning);
        }
        self.set_light_sampling(LightSampling::default());
        let learning = self.learn_light(view, size)?;
        // With other random numbers than the frames to come.
        let other = View { seed: !view.seed, ..*view };
        let (halves, _) = self.halves(self.structure()?, &other, size, WEIGHT_SAMPLES / 2, options);
        let weights = Weights::of(halves.each_ref());
        self.studied = Some(Studied { view: *view, size, learning, weights });
        Some(learning)
    }

    /// Time and noise of a frame in the view that was [studied](Self::study_view). `None` if none was.
    pub fn noisy_frame(
        &self,
        structure: &Structure,
        options: &RenderOptions,
    ) -> Option<(FrameTimes, ThreadTimes)> {
        let studied = self.studied.as_ref()?;
        let rendered = || self.halves(structure, &studied.view, studied.size, HALF_SAMPLES, options);
        let ((pictures, times_ms), threads) = self.watching_threads(rendered);
        let noise = FrameNoise::of([&pictures[0], &pictures[1]], &studied.weights);
        let passes = times_ms.len() as f64;
        let each = ThreadTimes {
            cpu_ms: threads.cpu_ms / passes,
            delay_ms: threads.delay_ms.map(|delay_ms| delay_ms / passes),
        };
        let times = FrameTimes::of(0.0, Summary::of(&times_ms).median);
        Some((FrameTimes { noise: Some(noise), ..times }, each))
    }

    /// Whether a [noisy frame](Self::noisy_frame)'s bias against plain sampling is found again.
    pub fn finds_again(&mut self, bias: &Bias, options: &RenderOptions) -> bool {
        let how = self.prepared.light_sampling();
        let expected = self.look(LightSampling::default(), WEIGHT_SAMPLES / 2, !SECOND_LOOK, options);
        let found = self.look(how, HALF_SAMPLES, SECOND_LOOK, options);
        found.zip(expected).is_some_and(|(found, expected)| found.confirms(&expected, bias))
    }

    /// Renders halves in the studied view and in one way. `mask` makes its seed another.
    fn look(
        &mut self,
        how: LightSampling,
        samples: u32,
        mask: u64,
        options: &RenderOptions,
    ) -> Option<Squares> {
        self.set_light_sampling(how);
        let Studied { view, size, .. } = self.studied.as_ref()?;
        let view = View { seed: view.seed ^ mask, ..*view };
        let (halves, _) = self.halves(self.structure()?, &view, *size, samples, options);
        Some(Squares::of(halves.each_ref()))
    }

    /// Two independent pictures of `samples` samples each, and the milliseconds of each sample.
    fn halves(
        &self,
        structure: &Structure,
        view: &View,
        size: [u32; 2],
        samples: u32,
        options: &RenderOptions,
    ) -> ([Picture; 2], Vec<f64>) {
        let mut times_ms = Vec::new();
        let pictures = [0, 1].map(|half| {
            let mut film = Film::new(size);
            let view = View { seed: view.seed.wrapping_mul(2).wrapping_add(half), ..*view };
            for _ in 0..samples {
                times_ms.push(self.render_with(structure, &view, options, &mut film).0);
            }
            film.picture()
        });
        (pictures, times_ms)
    }

    /// The needs that the shading kernel in use covers.
    pub fn needs(&self) -> Needs {
        self.prepared.needs
    }

    /// Number of render threads.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Version of Embree: major, minor, patch.
    pub fn embree_version(&self) -> (u32, u32, u32) {
        self.device.version()
    }

    /// Changes the scene, e.g. because something in it moved. The structures of the old one are dropped.
    pub fn set_scene(&mut self, scene: Arc<Scene>) {
        self.current = None;
        self.studied = None;
        self.shelf.clear();
        self.moments.clear();
        self.prepared = self.prepare(scene);
    }

    pub(crate) fn prepare(&self, scene: Arc<Scene>) -> Arc<Prepared> {
        Arc::new(self.pool.install(|| Prepared::new(scene)))
    }

    /// Builds a structure without keeping it, and says how long it took. For comparing many.
    pub fn build(&self, choice: &BuildChoice) -> Result<(Structure, f64), BuildError> {
        let begin = Instant::now();
        let structure = self.pool.install(|| built(&self.device, &self.prepared.scene, choice))?;
        Ok((structure, milliseconds(begin)))
    }

    /// The build of a structure as work for other threads.
    pub(crate) fn build_job(
        &self,
        choice: &BuildChoice,
    ) -> impl FnOnce() -> Result<Structure, BuildError> + Send + use<> {
        let (device, scene, choice) = (self.device.clone(), Arc::clone(self.scene()), *choice);
        move || built(&device, &scene, &choice)
    }

    /// Keeps a structure of the present scene that was built elsewhere.
    pub(crate) fn adopt(&mut self, built: Built) {
        self.current = Some(built);
    }

    /// Builds a structure for the frames to come; returns `build_ms`. After a failure the last one is kept.
    pub fn rebuild(&mut self, choice: &BuildChoice) -> Result<f64, BuildError> {
        self.make_ready(choice, false).map(|ready| ready.build_ms)
    }

    /// Makes ready for a trial, like [`Self::rebuild`]. With `reuse`, a kept structure serves again at times.
    pub fn make_ready(&mut self, choice: &BuildChoice, reuse: bool) -> Result<Ready, BuildError> {
        if reuse
            && let Some(current) = &mut self.current
            && current.serves_again(choice)
        {
            return Ok(current.ready());
        }
        let shelved = if reuse { self.shelf.take(choice) } else { None };
        let built = match shelved {
            Some(built) => built,
            None => {
                let (built, threads) = of_process(|| self.build(choice));
                let (structure, build_ms) = built?;
                Built { structure, choice: *choice, build_ms, threads, trials: 1, bytes: OnceLock::new() }
            }
        };
        let ready = built.ready();
        let before = self.current.replace(built);
        if reuse && let Some(before) = before {
            self.shelf.put(before);
        }
        Ok(ready)
    }

    /// Brings a structure of another moment, with as many triangles and instances, to this one; returns
    /// `build_ms`. After an error it is as it was or refitted.
    pub fn follow(&self, structure: &mut Structure, update: Update) -> Result<f64, BuildError> {
        let begin = Instant::now();
        let scene = &self.prepared.scene;
        let instances = scene.instances.as_ref();
        self.pool.install(|| structure.update(&self.device, &scene.triangles, instances, update))?;
        Ok(milliseconds(begin))
    }

    /// Moves on to another moment and brings the kept structure along; returns `build_ms`. One that does not
    /// fit the choice or the scene is rebuilt. If that fails, the structure is the former one, or none.
    pub fn animate(
        &mut self,
        scene: Arc<Scene>,
        choice: &BuildChoice,
        update: Update,
    ) -> Result<f64, BuildError> {
        let fits = {
            let before = self.scene();
            let same_objects = match (&before.instances, &scene.instances) {
                (None, None) => true,
                (Some(before), Some(now)) => before.same_objects(now),
                _ => false,
            };
            before.triangles.len() == scene.triangles.len() && same_objects
        };
        let kept = self.current.take().filter(|_| fits);
        self.set_scene(scene);
        match kept {
            Some(mut built) if built.choice == *choice => {
                let outcome = self.follow(&mut built.structure, update);
                built.bytes = OnceLock::new();
                self.current = Some(built);
                outcome
            }
            kept => {
                self.current = kept;
                self.rebuild(choice)
            }
        }
    }

    /// The kept structure.
    pub fn structure(&self) -> Option<&Structure> {
        self.current.as_ref().map(|built| &built.structure)
    }

    /// Brings the kept structure to the present moment, which its instances alone tell from its own.
    pub(crate) fn catch_up(&mut self, update: Update) -> Result<(), BuildError> {
        if let Some(mut built) = self.current.take() {
            self.follow(&mut built.structure, update)?;
            self.current = Some(built);
        }
        Ok(())
    }

    /// Bytes of the kept structure. The first call walks it: milliseconds per million triangles.
    pub fn structure_bytes(&self) -> Option<usize> {
        self.current.as_ref().map(Built::bytes)
    }

    /// Adds one sample to each pixel of the film with a given structure; returns `render_ms` and the counts.
    pub fn render_with(
        &self,
        structure: &Structure,
        view: &View,
        options: &RenderOptions,
        film: &mut Film,
    ) -> (f64, Counts) {
        let needs = self.needs();
        let sample = Sample { prepared: &self.prepared, view, options, needs, film, until: None };
        let begin = Instant::now();
        let (counts, _) = self.pool.install(|| structure.visit(sample));
        (milliseconds(begin), counts)
    }

    /// Adds one sample with the kept structure. `None` while there is none.
    pub fn render(&self, view: &View, options: &RenderOptions, film: &mut Film) -> Option<(f64, Counts)> {
        Some(self.render_with(self.structure()?, view, options, film))
    }

    /// Renders; no tile begins after `limit_ms`. Returns the times, and whether that is a whole frame.
    pub fn render_within(
        &self,
        limit_ms: Option<f64>,
        view: &View,
        options: &RenderOptions,
        film: &mut Film,
    ) -> Option<(f64, bool)> {
        let structure = self.structure()?;
        let begin = Instant::now();
        let limit = limit_ms.and_then(|limit_ms| Duration::try_from_secs_f64(limit_ms.max(0.0) / 1e3).ok());
        let until = limit.and_then(|limit| begin.checked_add(limit));
        let sample = Sample { prepared: &self.prepared, view, options, needs: self.needs(), film, until };
        let (_, is_whole) = self.pool.install(|| structure.visit(sample));
        Some((milliseconds(begin), is_whole))
    }

    /// Does some work, and returns the render threads' processor times meanwhile.
    pub fn watching_threads<R>(&self, work: impl FnOnce() -> R) -> (R, ThreadTimes) {
        // Asking the threads wakes them, for which they may wait. So it is done outside of the measured time.
        let cpu_before_ms = self.render_cpu_ms();
        let delay_before_ms = self.delay_ms();
        let result = work();
        let delay_ms = delay_before_ms.zip(self.delay_ms()).map(|(before, after)| (after - before).max(0.0));
        (result, ThreadTimes { cpu_ms: self.render_cpu_ms() - cpu_before_ms, delay_ms })
    }

    /// Processor time that the render threads have used so far, in milliseconds.
    fn render_cpu_ms(&self) -> f64 {
        self.pool.broadcast(|_| thread_cpu_ms()).iter().sum()
    }

    /// Time that the render threads have waited for a processor so far, in milliseconds.
    fn delay_ms(&self) -> Option<f64> {
        let all: Option<Vec<f64>> = self.delays.iter().map(RunQueueDelay::read_ms).collect();
        all.filter(|all| !all.is_empty()).map(|all| all.iter().sum())
    }
}

/// Pilot frames, to be compiled for each kind of structure.
struct Pilot<'a> {
    prepared: &'a Prepared,
    view: &'a View,
    size: [u32; 2],
}

impl Visitor for Pilot<'_> {
    type Output = Learnt;

    fn visit<I: Intersector>(self, intersector: &I) -> Learnt {
        learn(self.prepared, intersector, self.view, self.size)
    }
}

/// One sample a pixel, to be compiled for each kind of structure.
struct Sample<'a> {
    prepared: &'a Prepared,
    view: &'a View,
    options: &'a RenderOptions,
    needs: Needs,
    film: &'a mut Film,
    /// When no further tile is begun.
    until: Option<Instant>,
}

impl Visitor for Sample<'_> {
    /// And whether it is a whole sample.
    type Output = (Counts, bool);

    fn visit<I: Intersector>(self, intersector: &I) -> Self::Output {
        let Self { prepared, view, options, needs, film, until } = self;
        render_sample(prepared, intersector, view, options, needs, film, until)
    }
}

/// Threads for building or rendering; 0 for one a core.
pub(crate) fn worker_pool(name: &'static str, threads: usize) -> Result<rayon::ThreadPool, RendererError> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(move |index| format!("{name}-{index}"))
        // Denormal numbers cost hundreds of cycles each and Embree asks for this mode.
        .start_handler(|_| treewright_accel::set_flush_denormals())
        .build()
        .map_err(|source| RendererError::Threads { threads, source })
}

fn built(device: &Device, scene: &Scene, choice: &BuildChoice) -> Result<Structure, BuildError> {
    match &scene.instances {
        Some(instances) => build_instanced(device, &scene.triangles, instances, choice),
        None => build(device, &scene.triangles, choice),
    }
}

/// Milliseconds since `begin`.
pub fn milliseconds(begin: Instant) -> f64 {
    begin.elapsed().as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::Choice;
    use treewright_accel::NativeQuality;
    use treewright_scene::builtin;

    #[test]
    fn processor_time_is_that_of_the_threads_that_worked() {
        let options = builtin::Options { detail: 0.05, ..builtin::Options::default() };
        let scene = Arc::new(builtin::build("quick", &options).expect("it is built in"));
        let mut renderer = Renderer::new(scene.clone(), 0).expect("Embree starts");
        let native = Choice::native(NativeQuality::Medium);
        let (built, times) = of_process(|| renderer.rebuild(&native.build));
        assert!(built.is_ok() && times.cpu_ms > 0.0);
        let view = View { camera: scene.cameras[0], seed: 1, bounces: 2 };
        let mut film = Film::new([64, 48]);
        let begin = Instant::now();
        let ((), times) = renderer.watching_threads(|| {
            for _ in 0..4 {
                renderer.render(&view, &native.render, &mut film).expect("there is a structure");
            }
        });
        let (used_ms, elapsed_ms) = (times.cpu_ms, milliseconds(begin));
        assert!(
            used_ms > 0.0 && used_ms <= renderer.threads() as f64 * elapsed_ms + 1.0,
            "{used_ms} ms in {elapsed_ms} ms"
        );
        assert_eq!(times.delay_ms.is_some(), RunQueueDelay::of_this_thread().is_some());
    }

    #[test]
    fn times_without_delay_are_those_of_a_machine_of_ones_own() {
        let threads = |cpu_ms, delay_ms| ThreadTimes { cpu_ms, delay_ms };
        let times =
            FrameTimes::of(10.0, 30.0).with_threads(2, threads(5.0, Some(5.0)), threads(40.0, Some(20.0)));
        assert_eq!(times.undelayed(), FrameTimes::of(5.0, 20.0));
        assert_eq!(FrameTimes::of(10.0, 30.0).undelayed(), FrameTimes::of(10.0, 30.0));
    }
}
