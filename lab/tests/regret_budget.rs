//! The regret budget: over simulated sessions with drifting noise and adversarial states it is kept in every
//! one.
//!
//! The test judges the true regret, which the simulation knows and the tuner does not: at every frame, its
//! cost less the cost of the default in its place, under an equal speed of the machine.

#[path = "regret_budget/session.rs"]
mod session;

use session::Session;

#[test]
fn the_budget_is_kept_in_every_session() {
    let mut explored = 0;
    for seed in 0..120 {
        let session = Session::run(seed, 400, true);
        assert!(
            session.worst <= session.budget,
            "seed {seed}, {:?}: {} of {}",
            session.weather,
            session.worst,
            session.budget
        );
        explored += session.explored;
    }
    // A budget that is kept by never exploring is no achievement.
    assert!(explored > 1200, "{explored} of 48,000 frames explored");
}

#[test]
fn without_a_budget_the_same_sessions_overspend() {
    let broken = (0..40).filter(|&seed| {
        let session = Session::run(seed, 400, false);
        session.worst > session.budget
    });
    assert!(broken.count() > 30);
}
