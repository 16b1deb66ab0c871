//! Is the regret budget kept? Simulated sessions with drifting noise and adversarial states, as JSON.
//!
//! `cargo run --release -p treewright-lab --example regret_budget -- [SESSIONS] [FRAMES]`; 10,000 sessions of
//! 400 frames unless told otherwise. Of each kind of weather it tells in how many sessions the budget was
//! kept, how much of it was used, what the frames cost beside the default, and how many of the first 200
//! sessions overspend without a budget. The last line is the verdict.

mod session;

use std::collections::BTreeMap;
use std::process::ExitCode;

use session::{Session, Weather};

fn main() -> ExitCode {
    let argument = |index: usize, default: u64| match std::env::args().nth(index) {
        Some(text) => text.parse().ok().filter(|&count| count > 0),
        None => Some(default),
    };
    let (Some(sessions), Some(frames)) = (argument(1, 10_000), argument(2, 400)) else {
        println!(
            "usage: regret_budget [SESSIONS] [FRAMES], two counts of at least 1; 10000 and 400 unless given"
        );
        let is_help = std::env::args().skip(1).any(|text| text == "--help" || text == "-h");
        return if is_help { ExitCode::SUCCESS } else { ExitCode::from(2) };
    };
    let mut by_weather: BTreeMap<Weather, Vec<Session>> = BTreeMap::new();
    for seed in 0..sessions {
        let session = Session::run(seed, frames);
        by_weather.entry(session.weather).or_default().push(session);
    }
    let mut rows = Vec::new();
    let mut broken = 0;
    for (weather, all) in &by_weather {
        let over = all.iter().filter(|session| session.worst > session.budget).count();
        broken += over;
        let mut used: Vec<f64> = all.iter().map(|session| session.worst / session.budget).collect();
        used.sort_by(f64::total_cmp);
        let explored: u64 = all.iter().map(|session| session.explored).sum();
        let cost: f64 = all.iter().map(|session| session.cost_over_default).sum();
        rows.push(serde_json::json!({
            "weather": weather,
            "sessions": all.len(),
            "over_budget": over,
            "used_of_budget_median": used[used.len() / 2],
            "used_of_budget_most": used[used.len() - 1],
            "explored_share_of_frames": explored as f64 / (all.len() as u64 * frames) as f64,
            "over_budget_without_one": (0..sessions.min(200)).filter(|&seed| Weather::of(seed) == *weather).filter(|&seed| {
                let session = Session::run_without(seed, frames);
                session.worst > session.budget
            }).count(),
            "cost_over_default_mean": cost / all.len() as f64,
        }));
    }
    println!(
        "{}",
        serde_json::json!({ "sessions": sessions, "frames": frames, "over_budget": broken, "rows": rows })
    );
    if broken == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
