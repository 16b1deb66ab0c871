//! A search at one place, and groups of configurations in interleaved rounds.

use std::{collections::BTreeMap, sync::Arc};

use treewright_client::{Configuration, Indicators, Outcome};
use treewright_core::search::{AnySearch, Feedback, SearchSetup, Verdict};
use treewright_render_cli::error::{CliError, Result};
use treewright_renderer::frame::{FrameTimes, Renderer};
use treewright_renderer::tuning::search::{SearchSetting, trial};
use treewright_renderer::{
    disturbance::Watch, film::Film, integrator::View, space::TuningSpace, tuning::objective::Objective,
    tuning::verdict, tuning::workload::Workload,
};
use treewright_scene::{Camera, Scene, camera_path::CameraPath, indicators::SceneIndicators};

use super::record::{
    Conditions, Group, GroupKind, Iteration, METHOD, Member, Place, Provenance, Record, Search, cost,
};
use crate::geometry::geometry_hash;

/// Seed of the rays, common to all measurements.
const RAYS_SEED: u64 = 1;

/// A scene that is ready to be rendered from the cameras of its path.
#[derive(Debug)]
pub(crate) struct Stage {
    pub(crate) name: String,
    renderer: Renderer,
    space: Arc<TuningSpace>,
    cameras: Vec<Camera>,
    scene: SceneIndicators,
    workload: Workload,
    conditions: Conditions,
    provenance: Provenance,
    film: Film,
}

impl Stage {
    /// Sets a scene up, cameras in the middle of equal parts of its path. It must be the record's.
    pub(crate) fn new(
        name: &str,
        scene: &Arc<Scene>,
        space: &Arc<TuningSpace>,
        record: &Record,
    ) -> Result<Self> {
        let scene_hash = geometry_hash(scene);
        record.admit(name, &scene_hash)?;
        let conditions = &record.conditions;
        let path = CameraPath::of(scene);
        let moment = |camera: u32| (camera as f32 + 0.5) / conditions.cameras as f32;
        Ok(Self {
            name: name.to_owned(),
            renderer: Renderer::new(scene.clone(), conditions.threads)?,
            space: Arc::clone(space),
            cameras: (0..conditions.cameras).map(|camera| path.sample(moment(camera))).collect(),
            scene: SceneIndicators::of(scene),
            workload: Workload::of(scene, conditions.size, conditions.bounces),
            conditions: conditions.clone(),
            provenance: Provenance { scene_hash, program: env!("CARGO_PKG_VERSION").to_owned() },
            film: Film::new(conditions.size),
        })
    }

    /// Changes what stands in the scene; cameras stay where they are.
    pub(crate) fn set_scene(&mut self, scene: Scene) {
        self.renderer.set_scene(Arc::new(scene));
    }

    pub(crate) fn resize(&mut self, size: [u32; 2]) {
        self.conditions.size = size;
        self.film = Film::new(size);
    }

    pub(crate) fn set_seed(&mut self, seed: u64) {
        self.conditions.seed = seed;
    }

    pub(crate) fn place(&self, camera: u32) -> Place {
        Place { scene: self.name.clone(), camera }
    }

    pub(crate) fn state(&self, camera: u32) -> Indicators {
        self.workload.state(&self.scene.with_camera(&self.cameras[camera as usize]))
    }

    /// The setting in which one configuration is measured: one frame of equal rays.
    fn setting(&self, camera: u32, objective: Objective) -> SearchSetting {
        let view =
            View { camera: self.cameras[camera as usize], seed: RAYS_SEED, bounces: self.conditions.bounces };
        SearchSetting {
            objective,
            space: Arc::clone(&self.space),
            baseline: verdict::baseline(self.space.preset()).choice,
            view,
            size: self.conditions.size,
            frames: 1,
            indicators: self.state(camera),
        }
    }

    /// Runs a search of the core by [`METHOD`]; every iteration builds and renders. `None` when stopped.
    pub(crate) fn search(
        &mut self,
        camera: u32,
        objective: Objective,
        mut go_on: impl FnMut() -> bool,
    ) -> Result<Option<Search>> {
        let setting = self.setting(camera, objective);
        let space = self.space.space();
        let mut search = AnySearch::new(METHOD, self.setup(camera));
        let mut known: BTreeMap<Configuration, u32> = BTreeMap::new();
        let mut iterations = Vec::new();
        // The first frames of a process or scene are slower than all others.
        trial(&mut self.renderer, &self.space.default_configuration(), None, &setting, &mut self.film);
        let watch = Watch::begin();
        let mut frame_ms = Vec::new();
        while iterations.len() < self.conditions.iterations as usize {
            if !go_on() {
                return Ok(None);
            }
            let Some(point) = search.ask() else {
                return Err(CliError::Failed(format!("the search {} has no further point", METHOD.name())));
            };
            let configuration: Configuration = space.decode(&point.x).to_raw().into();
            let (outcome, times) = trial(&mut self.renderer, &configuration, None, &setting, &mut self.film);
            let cost = times.map(|times| cost(objective, &times));
            frame_ms.extend(times.map(|times| times.render_ms));
            let fresh = known.insert(configuration.clone(), 1).is_none();
            search
                .tell(point.id, Feedback { verdict: cost.map_or(Verdict::Infeasible, Verdict::Cost), fresh });
            let step = point.step.to_string();
            iterations.push(Iteration { configuration, step, outcome, times });
        }
        Ok(Some(Search {
            objective: objective.name().to_owned(),
            method: METHOD.name().to_owned(),
            place: self.place(camera),
            state: setting.indicators.iter().map(|(name, value)| (name.to_owned(), value)).collect(),
            iterations,
            other_cores: watch.end(self.renderer.threads(), &frame_ms).other_cores,
            provenance: Some(self.provenance.clone()),
        }))
    }

    fn setup(&self, camera: u32) -> SearchSetup {
        let space = self.space.space();
        // Each place draws points of its own.
        let state_id =
            self.name.bytes().fold(u64::from(camera), |sum, byte| sum.wrapping_mul(31) + u64::from(byte));
        SearchSetup::of(space, self.conditions.seed, state_id, self.conditions.iterations)
    }

    /// Builds and renders all in every round, each in another order. `None` when it was stopped.
    pub(crate) fn group(
        &mut self,
        kind: GroupKind,
        camera: u32,
        configurations: &[Configuration],
        rounds: u32,
        mut go_on: impl FnMut() -> bool,
    ) -> Option<Group> {
        let setting = self.setting(camera, Objective::Total);
        let member = |configuration: &Configuration| Member {
            configuration: configuration.clone(),
            rounds: Vec::new(),
            failure: None,
        };
        let mut members: Vec<Member> = configurations.iter().map(member).collect();
        let count = members.len();
        if let Some(first) = configurations.first() {
            trial(&mut self.renderer, first, None, &setting, &mut self.film);
        }
        let watch = Watch::begin();
        for round in 0..rounds as usize {
            for turn in 0..count {
                if !go_on() {
                    return None;
                }
                // An odd stride in every second round also turns neighbours round.
                let index =
                    if round % 2 == 0 { (round + turn) % count } else { (round + count - turn) % count };
                let member = &mut members[index];
                if member.failure.is_some() {
                    continue;
                }
                match trial(&mut self.renderer, &member.configuration, None, &setting, &mut self.film) {
                    (_, Some(times)) => member.rounds.push(times),
                    (outcome, None) => member.failure = Some(reason(&outcome)),
                }
            }
        }
        let frame_ms: Vec<f64> = members.iter().flat_map(|member| render_ms(&member.rounds)).collect();
        let other_cores = watch.end(self.renderer.threads(), &frame_ms).other_cores;
        let provenance = Some(self.provenance.clone());
        Some(Group { kind, place: self.place(camera), members, other_cores, provenance })
    }
}

fn render_ms(rounds: &[FrameTimes]) -> impl Iterator<Item = f64> {
    rounds.iter().map(|times| times.render_ms)
}

fn reason(outcome: &Outcome) -> String {
    match outcome {
        Outcome::Infeasible { reason } | Outcome::Failed { reason } => reason.clone(),
        _ => "it was not measured".to_owned(),
    }
}

pub(crate) const ALL: usize = usize::MAX;
/// Trials of a search after which the best so far is measured again.
pub(crate) const MILESTONES: [usize; 5] = [5, 10, 20, 40, 80];

/// The best of the first iterations, up to a given number; of [`ALL`], as the paper's roofline has it.
pub(crate) fn best_within(search: &Search, trials: usize, objective: Objective) -> Option<(&Iteration, f64)> {
    let costs = search
        .iterations
        .iter()
        .take(trials)
        .filter_map(|iteration| Some((iteration, cost(objective, iteration.times.as_ref()?))));
    costs.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// `count` cameras in an order whose every beginning is spread evenly: the bits of 0, 1, 2, … turned round.
pub(crate) fn spread(count: u32) -> Vec<u32> {
    let bits = count.next_power_of_two().trailing_zeros();
    let turned = |index: u32| if bits == 0 { 0 } else { index.reverse_bits() >> (32 - bits) };
    (0..count.next_power_of_two()).map(turned).filter(|camera| *camera < count).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_spread_and_each_comes_once() {
        assert_eq!(spread(8), [0, 4, 2, 6, 1, 5, 3, 7]);
        for count in [1, 2, 3, 20, 100] {
            let mut all = spread(count);
            assert!(all.len() == count as usize);
            all.sort_unstable();
            assert!(all.into_iter().eq(0..count), "{count}");
        }
    }
}
