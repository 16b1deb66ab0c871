//! A structure that follows a scene in motion, and the episodes in which ways to follow are measured.
//!
//! Refitting a tree pays now and costs later: its boxes grow and overlap, which a single frame does not show.
//! A trial is therefore an episode, one stretch of motion from a fresh build on, which all trials share. Its
//! cost is the mean over all of its frames.

use std::{ops::Range, sync::Arc};

use treewright_accel::{BuildError, Instance, Structure, Update};
use treewright_client::episode_trend;
use treewright_scene::Scene;

use crate::frame::{FrameTimes, Renderer};
use crate::limits::{EPISODE_FRAMES_MAX, EPISODE_TRIANGLES_MAX};
use crate::scheduling::{ThreadTimes, of_process};
use crate::{film::Film, integrator::View, space::Choice};

/// The period of structures that are never rebuilt: longer than any episode.
pub const NEVER: u32 = EPISODE_FRAMES_MAX;

/// A structure is rebuilt before its period ends once a frame costs this factor of the first after its build,
/// and the frame before was dear as well: a single one may have been disturbed.
const DECAY_MOST: f64 = 2.0;

/// Frames are dear from this factor on. It is low, so that fast decay is seen in time: where each frame costs
/// up to 1.7 times the one before, the mean stays below [`DECAY_MOST`].
const DECAY_DEAR: f64 = 1.25;

/// The age and decay of a structure since its build, which decide when it is rebuilt.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wear {
    age: u32,
    /// The frame after the build, in milliseconds.
    fresh_ms: Option<f64>,
    is_dear: bool,
    /// Whether it was too dear, after another dear one.
    is_worn: bool,
}

impl Wear {
    /// Counts a frame in which the structure has to follow. Returns whether it is to be rebuilt, because its
    /// `period` is over or it has decayed; the count then begins again.
    pub fn is_over(&mut self, period: u32) -> bool {
        self.age += 1;
        let is_over = period < NEVER && self.age >= period || self.is_worn;
        if is_over {
            *self = Self::default();
        }
        is_over
    }

    /// Takes note of what a frame took, the structure's following left out.
    pub fn rendered(&mut self, render_ms: f64) {
        let fresh_ms = *self.fresh_ms.get_or_insert(render_ms);
        self.is_worn = self.is_dear && render_ms > DECAY_MOST * fresh_ms;
        self.is_dear = render_ms > DECAY_DEAR * fresh_ms;
    }
}

/// A structure that follows.
#[derive(Debug)]
pub struct Follower {
    structure: Structure,
    choice: Choice,
    wear: Wear,
}

impl Follower {
    /// Builds over the renderer's scene; returns the build time in milliseconds as well.
    ///
    /// # Errors
    /// The structure cannot be built.
    pub fn build(renderer: &Renderer, choice: &Choice) -> Result<(Self, f64), BuildError> {
        let (structure, build_ms) = renderer.build(&choice.build)?;
        Ok((Self { structure, choice: *choice, wear: Wear::default() }, build_ms))
    }

    /// Brings the structure to the present moment of the renderer's scene, or rebuilds it if that is due:
    /// over instances those parts alone that moved since they were built. Returns the time in milliseconds.
    ///
    /// # Errors
    /// As [`Renderer::follow`]; the structure can still be used where the scene has as many triangles.
    pub fn follow(&mut self, renderer: &Renderer) -> Result<f64, BuildError> {
        if !self.wear.is_over(self.choice.period) && self.choice.update != Update::Rebuild {
            return renderer.follow(&mut self.structure, self.choice.update);
        }
        if renderer.scene().instances.is_some() {
            self.wear = Wear::default();
            return renderer.follow(&mut self.structure, Update::Rebuild);
        }
        let (fresh, build_ms) = Self::build(renderer, &self.choice)?;
        *self = fresh;
        Ok(build_ms)
    }

    /// Renders one sample a pixel with it; returns the time in milliseconds.
    pub fn render(&mut self, renderer: &Renderer, view: &View, film: &mut Film) -> f64 {
        let (render_ms, _) = renderer.render_with(&self.structure, view, &self.choice.render, film);
        self.wear.rendered(render_ms);
        render_ms
    }
}

/// The times of an episode.
#[derive(Clone, Debug, Default)]
pub struct Episode {
    /// Frame by frame; the first one has its build.
    pub frames: Vec<FrameTimes>,
    /// Whether it was ended before its last frame.
    pub is_stopped: bool,
    /// Memory of the structure after the last frame, in bytes.
    pub structure_bytes: Option<usize>,
}

impl Episode {
    /// The mean frame, and how the second half's compares with the first's.
    pub fn mean(&self) -> FrameTimes {
        let count = self.frames.len().max(1) as f64;
        let mean = |of: fn(&FrameTimes) -> f64| self.frames.iter().map(of).sum::<f64>() / count;
        let known = |of: fn(&FrameTimes) -> Option<f64>| {
            let all: Option<Vec<f64>> = self.frames.iter().map(of).collect();
            all.map(|all| all.iter().sum::<f64>() / count)
        };
        FrameTimes {
            build_cpu_ms: known(|frame| frame.build_cpu_ms),
            render_cpu_ms: known(|frame| frame.render_cpu_ms),
            build_delay_ms: known(|frame| frame.build_delay_ms),
            render_delay_ms: known(|frame| frame.render_delay_ms),
            frames: u32::try_from(self.frames.len()).ok(),
            trend: episode_trend(&self.costs_ms()),
            structure_bytes: self.structure_bytes,
            ..FrameTimes::of(mean(|frame| frame.build_ms), mean(|frame| frame.render_ms))
        }
    }

    fn costs_ms(&self) -> Vec<f64> {
        self.frames.iter().map(|frame| frame.build_ms + frame.render_ms).collect()
    }

    /// The time of all of its frames.
    pub fn total_ms(&self) -> f64 {
        self.costs_ms().iter().sum()
    }
}

/// The number of triangles and instances of which each frame has its own.
fn kept(scene: &Scene) -> usize {
    scene.triangles.len() + scene.instances.as_ref().map_or(0, |instances| instances.placed().len())
}

/// Whether so many frames of a scene can be kept at once.
///
/// # Errors
/// They cannot. The text says why, and ends in that fewer are to be asked for.
pub fn fits(scene: &Scene, frames: u32) -> Result<(), String> {
    let kept = kept(scene);
    if kept.saturating_mul(frames as usize) <= EPISODE_TRIANGLES_MAX {
        return Ok(());
    }
    Err(format!(
        "{frames} frames of {kept} triangles and instances are more than the {EPISODE_TRIANGLES_MAX} that are kept \
         at once; ask for fewer"
    ))
}

impl Renderer {
    /// Prepares an episode: the moments of a scene that its frames show. The renderer's scene becomes the
    /// first of them.
    ///
    /// # Panics
    /// If there are none.
    pub fn set_episode(&mut self, moments: &[Arc<Scene>]) {
        self.set_scene(Arc::clone(&moments[0]));
        self.moments = moments[1..].iter().map(|moment| self.prepare(Arc::clone(moment))).collect();
        self.moments.insert(0, Arc::clone(&self.prepared));
    }

    /// Runs the episode that was prepared: builds over its first moment, follows through the others, and
    /// renders each. Ends early when more than `limit_ms` milliseconds are over, looked at after each frame.
    ///
    /// # Errors
    /// The structure cannot be built.
    pub fn episode(
        &mut self,
        choice: &Choice,
        view: &View,
        film: &mut Film,
        limit_ms: Option<f64>,
    ) -> Result<Episode, BuildError> {
        let moments = self.moments.clone();
        let outcome = self.through(&moments, choice, view, film, limit_ms);
        if let Some(first) = moments.into_iter().next() {
            self.prepared = first;
        }
        outcome
    }

    fn through(
        &mut self,
        moments: &[Arc<crate::integrator::Prepared>],
        choice: &Choice,
        view: &View,
        film: &mut Film,
        limit_ms: Option<f64>,
    ) -> Result<Episode, BuildError> {
        let mut episode = Episode::default();
        let mut follower: Option<Follower> = None;
        for moment in moments {
            self.prepared = Arc::clone(moment);
            let followed = |follower: &mut Option<Follower>| match follower {
                Some(follower) => follower.follow(self),
                None => {
                    let (built, build_ms) = Follower::build(self, choice)?;
                    *follower = Some(built);
                    Ok(build_ms)
                }
            };
            let (build_ms, build): (_, ThreadTimes) = of_process(|| followed(&mut follower));
            let build_ms = build_ms?;
            let Some(follower) = &mut follower else { break };
            film.clear();
            let (render_ms, render) = self.watching_threads(|| follower.render(self, view, film));
            let times = FrameTimes::of(build_ms, render_ms).with_threads(self.threads(), build, render);
            episode.frames.push(times);
            if limit_ms.is_some_and(|limit_ms| episode.total_ms() > limit_ms) {
                episode.is_stopped = episode.frames.len() < moments.len();
                break;
            }
        }
        episode.structure_bytes = follower.map(|follower| follower.structure.statistics().bytes);
        Ok(episode)
    }

    /// The number of frames of the prepared episode; 0 while there is none.
    pub fn episode_frames(&self) -> usize {
        self.moments.len()
    }

    /// The effect of an episode on a structure of the kind of `choice`: the share of triangles that move in a
    /// frame, and a refitted tree's cost at the end over a fresh one's. `None` without an episode or a tree.
    pub fn motion(&mut self, choice: &Choice) -> Result<Option<MotionFacts>, BuildError> {
        let [first, .., last] = self.moments.as_slice() else { return Ok(None) };
        let (first, second, last) = (Arc::clone(first), Arc::clone(&self.moments[1]), Arc::clone(last));
        let moving = moving_share(&first.scene, &second.scene);
        let cost = |structure: &Structure| structure.statistics().tree.map(|tree| tree.sah_cost);
        self.prepared = Arc::clone(&last);
        let fresh = self.build(&choice.build).map(|(structure, _)| cost(&structure));
        self.prepared = Arc::clone(&first);
        let fresh = fresh?;
        let (mut structure, _) = self.build(&choice.build)?;
        self.prepared = last;
        let followed = self.follow(&mut structure, Update::Refit);
        self.prepared = first;
        followed?;
        let growth = cost(&structure).zip(fresh).map(|(refitted, fresh)| refitted / fresh);
        Ok(growth.map(|growth| MotionFacts {
            moving_share: moving,
            cost_growth: growth.max(1.0),
            frames: self.moments.len() as u32,
        }))
    }
}

/// Share of triangles that are elsewhere a moment later, those of every instance counted.
fn moving_share(before: &Scene, after: &Scene) -> f64 {
    let moves = |one: &usize| before.triangles.corners(*one) != after.triangles.corners(*one);
    let count = |among: Range<usize>| among.filter(moves).count() as u64;
    let moving = match (&before.instances, &after.instances) {
        (Some(first), Some(second)) => {
            let objects = first.objects().iter();
            let of_objects = objects.map(|range| count(range.start as usize..range.end as usize));
            let of_objects: Vec<u64> = of_objects.collect();
            let pairs = first.placed().iter().zip(second.placed());
            let of_instance = |(one, later): (&Instance, &Instance)| {
                let object = one.object as usize;
                let rests = one.to_world == later.to_world;
                if rests { of_objects[object] } else { first.objects()[object].len() as u64 }
            };
            pairs.map(of_instance).sum::<u64>()
        }
        _ => count(0..before.triangles.len().min(after.triangles.len())),
    };
    moving as f64 / before.placed().count().max(1) as f64
}

/// The effect of an episode on a structure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionFacts {
    /// Share of triangles that move, 0 to 1; those of every instance count.
    pub moving_share: f64,
    /// Cost of a refitted tree over a fresh one's at the end, at least 1.
    pub cost_growth: f64,
    /// Frames of the episode.
    pub frames: u32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::{Premises, Preset, TuningSpace, parse};
    use treewright_scene::builtin;
    use treewright_scene::motion::{Motion, Mover};

    fn moments(motion: Motion, frames: u16) -> Vec<Arc<Scene>> {
        moments_of("quick", 0.1, motion, frames)
    }

    fn moments_of(name: &str, detail: f32, motion: Motion, frames: u16) -> Vec<Arc<Scene>> {
        let options = builtin::Options { detail, ..builtin::Options::default() };
        let scene = Arc::new(builtin::build(name, &options).expect("it is built in"));
        let mover = Mover::new(scene, motion).expect("it can move so");
        (0..frames).map(|frame| mover.at(f32::from(frame) / 40.0).expect("it stays in range")).collect()
    }

    fn choices() -> Vec<Choice> {
        let space = TuningSpace::new(Preset::Follow, &Premises::all());
        let texts = [
            "period=1",
            "repair_above=1.02",
            "tree=good,repair_above=4",
            "tree=middle,repair_above=1.1",
            "tree=native_low,period=3",
            "tree=native_medium",
        ];
        texts.map(|text| space.choice(&parse(text).expect("words")).expect("it is one of the space")).to_vec()
    }

    #[test]
    fn instances_are_kept_too() {
        let options = builtin::Options { detail: 0.01, ..builtin::Options::default() };
        let forest = builtin::build("forest", &options).expect("it is built in");
        assert!(kept(&forest) > forest.triangles.len());
        let flat = forest.flattened().expect("it is small");
        assert_eq!(kept(&flat), flat.triangles.len());
    }

    #[test]
    fn an_episode_shows_the_same_frames_whatever_follows() {
        let quick = [Motion::Twist, Motion::Explode].map(|motion| (motion, moments(motion, 6)));
        let forest = (Motion::Crowd, moments_of("forest", 0.01, Motion::Crowd, 6));
        for (motion, moments) in quick.into_iter().chain([forest]) {
            let mut renderer = Renderer::new(Arc::clone(&moments[0]), 0).expect("Embree starts");
            renderer.set_episode(&moments);
            let view = View { camera: moments[0].cameras[0], seed: 1, bounces: 2 };
            let mut pictures = Vec::new();
            for choice in choices() {
                let mut film = Film::new([40, 30]);
                let episode = renderer.episode(&choice, &view, &mut film, None).expect("it builds");
                assert!(episode.frames.len() == 6 && !episode.is_stopped);
                assert!(episode.frames.iter().all(|frame| frame.build_ms > 0.0 && frame.render_ms > 0.0));
                assert!(Arc::ptr_eq(renderer.scene(), &moments[0]), "it is back at the first moment");
                // The film has the last frame.
                pictures.push(film.picture());
            }
            let last = moments[5].flattened().expect("it is small");
            renderer.set_scene(Arc::new(last));
            renderer.rebuild(&choices()[0].build).expect("it builds");
            let mut film = Film::new([40, 30]);
            renderer.render(&view, &choices()[0].render, &mut film).expect("it was built");
            let fresh = film.picture();
            // Instances round a little differently, and where leaves overlap a path may turn elsewhere.
            let most = if motion == Motion::Crowd { 0.03 } else { 0.01 };
            for picture in &pictures {
                let difference = fresh.mean_relative_difference(picture);
                assert!(difference < most, "{motion:?}: {difference}");
            }
        }
    }

    #[test]
    fn a_dear_episode_ends_early_and_says_so() {
        let moments = moments(Motion::Sway, 6);
        let mut renderer = Renderer::new(Arc::clone(&moments[0]), 0).expect("Embree starts");
        renderer.set_episode(&moments);
        let view = View { camera: moments[0].cameras[0], seed: 1, bounces: 2 };
        let mut film = Film::new([40, 30]);
        let episode = renderer.episode(&choices()[0], &view, &mut film, Some(0.0)).expect("it builds");
        assert!(episode.is_stopped && episode.frames.len() == 1);
    }

    #[test]
    fn the_mean_has_every_frame_and_the_trend_leaves_the_first_build_out() {
        let frame = |build_ms, render_ms| FrameTimes {
            build_cpu_ms: Some(1.0),
            ..FrameTimes::of(build_ms, render_ms)
        };
        let mut frames = vec![frame(90.0, 10.0)];
        frames.extend([frame(1.0, 9.0), frame(1.0, 9.0), frame(1.0, 19.0), frame(1.0, 19.0)]);
        let mean = Episode { frames, structure_bytes: Some(64), ..Episode::default() }.mean();
        assert!((mean.build_ms - 18.8).abs() < 1e-9 && (mean.render_ms - 13.2).abs() < 1e-9);
        assert_eq!((mean.trend, mean.frames, mean.build_cpu_ms), (Some(2.0), Some(5), Some(1.0)));
        assert_eq!((mean.render_cpu_ms, mean.structure_bytes), (None, Some(64)));
    }

    #[test]
    fn what_decays_and_what_is_old_is_built_anew() {
        let over = |period, frames_ms: &[f64]| {
            let mut wear = Wear::default();
            let each = frames_ms.iter().map(|frame_ms| {
                let is_over = wear.is_over(period);
                wear.rendered(*frame_ms);
                is_over
            });
            each.collect::<Vec<_>>()
        };
        assert_eq!(over(2, &[1.0; 5]), [false, true, false, true, false]);
        assert!(!over(NEVER, &[1.0; 500]).contains(&true));
        // One slow frame is nothing, two are; a fresh structure has a price of its own.
        let decaying = [1.0, 1.2, 2.1, 1.0, 1.9, 2.1, 3.0, 3.0, 3.0];
        let built = over(NEVER, &decaying).iter().position(|is_over| *is_over);
        assert_eq!((built, over(NEVER, &decaying).iter().filter(|one| **one).count()), (Some(6), 1));
    }

    #[test]
    fn a_structure_that_decays_is_left_before_it_costs_twice_a_fresh_one() {
        for growth in [1.01, 1.03, 1.1, 1.2, 1.4, 1.7] {
            let (mut wear, mut frame_ms, mut sum_ms) = (Wear::default(), 1.0, 0.0);
            for _ in 0..EPISODE_FRAMES_MAX {
                if wear.is_over(NEVER) {
                    frame_ms = 1.0;
                }
                wear.rendered(frame_ms);
                sum_ms += frame_ms;
                frame_ms *= growth;
            }
            let mean_ms = sum_ms / f64::from(EPISODE_FRAMES_MAX);
            assert!(mean_ms < DECAY_MOST, "{growth}: {mean_ms}");
        }
    }

    #[test]
    fn motions_are_told_apart() {
        let facts = |motion| {
            let moments = moments(motion, 8);
            let mut renderer = Renderer::new(Arc::clone(&moments[0]), 0).expect("Embree starts");
            assert_eq!(renderer.motion(&choices()[0]).expect("it builds"), None, "there is no episode yet");
            renderer.set_episode(&moments);
            renderer.motion(&choices()[0]).expect("it builds").expect("there is an episode")
        };
        let (sway, swarm) = (facts(Motion::Sway), facts(Motion::Swarm));
        assert!(sway.moving_share > 0.9 && sway.frames == 8);
        assert!(swarm.cost_growth > 1.2 * sway.cost_growth, "{swarm:?} and {sway:?}");
        let moments = moments_of("forest", 0.01, Motion::Crowd, 8);
        let (scene, mut renderer) =
            (&moments[0], Renderer::new(Arc::clone(&moments[0]), 0).expect("Embree starts"));
        renderer.set_episode(&moments);
        let crowd = renderer.motion(&choices()[0]).expect("it builds").expect("there is an episode");
        let instances = scene.instances.as_ref().expect("it is made of instances");
        let ground = instances.objects()[instances.placed()[0].object as usize].len() as f64;
        let share = 1.0 - ground / scene.placed().count() as f64;
        assert!((crowd.moving_share - share).abs() < 1e-9 && crowd.cost_growth > 1.0, "{crowd:?}, {share}");
    }
}
