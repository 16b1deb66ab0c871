//! Leases that end, are renewed or given back, and clients that race.

mod common;

use std::collections::BTreeSet;

use common::{Server, assert_refused, done, get, report, suggest};
use tonic::Code;
use treewright_proto::v1 as wire;

#[tokio::test]
async fn an_abandoned_trial_is_handed_out_again() {
    let (_server, mut client) = Server::with_hall().await;
    let first = suggest(&mut client, "a", 10.0).await;
    let abandon = |trial: &str| wire::AbandonTrialRequest { trial: trial.to_owned() };
    for _ in 0..2 {
        // Idempotent.
        let given_back = client.abandon_trial(abandon(&first.name)).await.unwrap().into_inner();
        assert_eq!(given_back.state(), wire::TrialState::Abandoned);
    }
    let second = suggest(&mut client, "b", 10.0).await;
    assert_ne!(second.name, first.name);
    assert_eq!(second.configuration, first.configuration);

    let answer = client.report(report(&first.name, 1.0)).await;
    assert_refused(answer, Code::FailedPrecondition, "trial 1 was abandoned");
    done(&mut client, &second.name, 1.0).await;
    let answer = client.abandon_trial(abandon(&second.name)).await;
    assert_refused(answer, Code::FailedPrecondition, "trial 2 is already completed");
    let answer = client.abandon_trial(abandon("studies/hall/trials/99")).await;
    assert_refused(answer, Code::NotFound, "trial 99");
}

#[tokio::test]
async fn a_lease_ends_and_a_late_report_still_counts() {
    let (server, mut client) = Server::with_hall().await;
    let first = suggest(&mut client, "a", 10.0).await;
    server.clock.advance_ms(60_001);
    // The configuration goes to the next client that asks.
    let second = suggest(&mut client, "b", 10.0).await;
    assert_ne!(second.name, first.name);
    assert_eq!(second.configuration, first.configuration);
    assert_eq!(get(&mut client, &first.name).await.state(), wire::TrialState::Expired);

    let late = done(&mut client, &first.name, 3.0).await;
    assert!(!late.duplicate);
    let stored = late.trial.unwrap();
    assert!(stored.late);
    assert_eq!((stored.state(), stored.cost), (wire::TrialState::Completed, Some(3.0)));
    let again = done(&mut client, &first.name, 9.0).await;
    assert!(again.duplicate);
    assert_eq!(again.trial.unwrap(), stored);
}

#[tokio::test]
async fn leases_end_without_anyone_asking() {
    let (server, mut client) = Server::with_hall().await;
    let trial = suggest(&mut client, "a", 10.0).await;
    server.clock.advance_ms(60_001);
    // The sweep comes by within a period; reading does not end leases.
    for _ in 0..200 {
        if get(&mut client, &trial.name).await.state() == wire::TrialState::Expired {
            return;
        }
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    panic!("the lease was never ended");
}

#[tokio::test]
async fn a_lease_can_be_extended_while_the_trial_is_open() {
    let (server, mut client) = Server::with_hall().await;
    let trial = suggest(&mut client, "a", 10.0).await;
    let extend = |trial: &str| wire::ExtendLeaseRequest { trial: trial.to_owned() };
    for _ in 0..3 {
        server.clock.advance_ms(50_000);
        let extended = client.extend_lease(extend(&trial.name)).await.unwrap().into_inner();
        assert_eq!(extended.state(), wire::TrialState::Open);
    }
    done(&mut client, &trial.name, 1.0).await;
    let answer = client.extend_lease(extend(&trial.name)).await;
    assert_refused(answer, Code::FailedPrecondition, "trial 1 is Completed, not open");
    let answer = client.extend_lease(extend("studies/hall/trials/99")).await;
    assert_refused(answer, Code::NotFound, "trial 99");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn eight_clients_in_one_state_never_share_an_open_trial() {
    let directory = tempfile::tempdir().unwrap();
    let (server, mut client) = Server::on_disk_with_hall(&directory.path().join("studies.db")).await;
    let mut tasks = Vec::new();
    for number in 0..8 {
        let mut client = server.client().await;
        tasks.push(tokio::spawn(async move {
            let name = format!("client-{number}");
            let mut seen = Vec::new();
            for round in 0..6 {
                let trial = suggest(&mut client, &name, 10.0).await;
                assert_eq!(trial.client_id, name);
                let answer = done(&mut client, &trial.name, f64::from(5 + round)).await;
                assert!(!answer.duplicate, "someone else reported {}", trial.name);
                seen.push(trial.name);
            }
            seen
        }));
    }
    let mut all = Vec::new();
    for task in tasks {
        all.extend(task.await.expect("a client"));
    }
    let distinct: BTreeSet<&String> = all.iter().collect();
    assert_eq!((all.len(), distinct.len()), (48, 48));
    let name = "studies/hall".to_owned();
    let study = client.get_study(wire::GetStudyRequest { name }).await.unwrap().into_inner();
    assert_eq!(study.statistics.unwrap().completed_trials, 48);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn of_many_late_reports_at_once_one_is_taken() {
    let directory = tempfile::tempdir().unwrap();
    let (server, mut client) = Server::on_disk_with_hall(&directory.path().join("studies.db")).await;
    for _ in 0..5 {
        let trial = suggest(&mut client, "a", 10.0).await;
        server.clock.advance_ms(60_001);
        let mut tasks = Vec::new();
        for render_ms in 1..=8_u32 {
            let (mut client, name) = (client.clone(), trial.name.clone());
            tasks.push(tokio::spawn(async move { done(&mut client, &name, f64::from(render_ms)).await }));
        }
        let mut taken = Vec::new();
        let mut stored = BTreeSet::new();
        for task in tasks {
            let answer = task.await.expect("a client");
            let cost = answer.trial.expect("a trial").cost.expect("a cost");
            stored.insert(cost.to_bits());
            if !answer.duplicate {
                taken.push(cost);
            }
        }
        assert_eq!(taken.len(), 1);
        assert_eq!(stored, BTreeSet::from([taken[0].to_bits()]));
    }
    server.stop().await;
}
