//! Machines of one study: the reach of their measurements, over the wire and after a restart.

mod common;

use std::collections::BTreeMap;

use common::{Client, Server, ask, done};
use treewright_proto::v1 as wire;

/// A frame of a client on a machine; costs are `factor` times as high there.
async fn frame(client: &mut Client, id: &str, embree: &str, threads: i32, factor: f64) -> wire::Trial {
    let mut request = ask(id, 10.0);
    let fingerprint = request.fingerprint.as_mut().expect("a machine");
    fingerprint.threads = threads;
    fingerprint.software = BTreeMap::from([("embree".to_owned(), embree.to_owned())]);
    let trial = client.suggest(request).await.expect("a trial").into_inner();
    let values = &trial.configuration.as_ref().expect("a configuration").values;
    let leaf = |name: &str| match values[name].kind {
        Some(wire::value::Kind::Integer(leaf)) => leaf as f64,
        _ => panic!("{name} is an integer"),
    };
    // The default, leaves of 1 to 8, costs 34; leaves of 12 to 24 cost 10.
    let cost = 10.0 + (leaf("min_leaf") - 12.0).abs() + (leaf("max_leaf") - 24.0).abs() * 0.8;
    done(client, &trial.name, factor * cost).await;
    trial
}

fn reason(trial: &wire::Trial) -> (&str, &str) {
    let reason = trial.reason.as_ref().expect("a reason");
    (&reason.source, &reason.step)
}

#[tokio::test]
async fn a_new_machine_starts_from_its_group_and_new_software_from_the_fleet() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("studies.db");
    let (server, mut client) = Server::on_disk_with_hall(&path).await;
    let mut best = f64::INFINITY;
    for _ in 0..50 {
        let trial = frame(&mut client, "first", "4.4.0", 16, 1.0).await;
        best = best.min(common::get(&mut client, &trial.name).await.cost.expect("measured"));
    }
    assert!(best < 20.0, "{best}");

    // Another number of threads, four times as slow: the default, then the best of the first.
    let default = frame(&mut client, "second", "4.4.0", 4, 4.0).await;
    assert_eq!(default.mode(), wire::Mode::Default);
    let taken_over = frame(&mut client, "second", "4.4.0", 4, 4.0).await;
    assert_eq!(reason(&taken_over), ("group", "transfer"));
    let cost = common::get(&mut client, &taken_over.name).await.cost.expect("measured");
    assert!((cost - 4.0 * best).abs() < 1e-9, "{cost} and {best}");
    let predicted = taken_over.predicted_cost.expect("by the factor of the default");
    assert!(predicted > 2.0 * best && predicted < 8.0 * best, "{predicted} and {best}");
    assert_ne!(default.state_id, 1);

    // Each gets its own measurements; a client without a machine gets those of the one with the most frames.
    let own = ask("second", 10.0).fingerprint.map(|own| wire::Fingerprint {
        threads: 4,
        software: BTreeMap::from([("embree".to_owned(), "4.4.0".to_owned())]),
        ..own
    });
    for (fingerprint, factor) in [(own, 4.0), (None, 1.0)] {
        let (study, indicators) = ("studies/hall".to_owned(), ask("second", 10.0).indicators);
        let question = wire::GetBestRequest { study, indicators, fingerprint, ..Default::default() };
        let answer = client.get_best(question).await.expect("measured").into_inner();
        assert!((answer.cost - factor * best).abs() < 1e-9, "{answer:?}");
    }

    // A restart changes nothing, and a machine of that hardware with other software is no group any more.
    server.stop().await;
    let server = Server::on_disk(&path, common::START_MS + 1000).await;
    let mut client = server.client().await;
    let again = frame(&mut client, "second", "4.4.0", 4, 4.0).await;
    assert_eq!(again.state_id, taken_over.state_id);
    let newer = frame(&mut client, "second", "4.5.0", 4, 4.0).await;
    assert!(newer.state_id > again.state_id);
    let newer = frame(&mut client, "second", "4.5.0", 4, 4.0).await;
    assert_eq!(reason(&newer), ("fleet", "transfer"));
    let summary = &newer.reason.as_ref().expect("a reason").summary;
    assert!(summary.contains("embree 4.4.0 -> 4.5.0"), "{summary}");
    server.stop().await;
}
