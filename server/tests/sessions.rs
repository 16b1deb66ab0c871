//! A session's own policy holds for its own answers, and leaves nothing behind.

mod common;

use common::{Client, Server, ask, assert_refused, create, creation, done, study};
use tonic::Code;
use treewright_proto::convert::timestamp_to_wire;
use treewright_proto::v1::{self as wire, Rule};

/// Explores often, also where the study itself does not.
const WISHES: wire::SessionPolicy = wire::SessionPolicy {
    epsilon: Some(1.0),
    trials_per_state: Some(6),
    abort_above: Some(3.0),
    explore_until: None,
};

fn explorer(session: u64, wishes: Option<wire::SessionPolicy>) -> wire::SuggestRequest {
    wire::SuggestRequest { session, session_policy: wishes, ..ask("explorer", 5.0) }
}

/// A study whose policy does not explore.
async fn calm(client: &mut Client) -> wire::Study {
    let policy = wire::Policy { epsilon: Some(0.0), trials_per_state: 3, ..wire::Policy::default() };
    let study = wire::Study { policy: Some(policy), ..study() };
    client.create_study(creation("hall", study)).await.expect("created").into_inner()
}

async fn policy(client: &mut Client) -> wire::Policy {
    let request = wire::GetStudyRequest { name: "studies/hall".to_owned() };
    client.get_study(request).await.expect("there").into_inner().policy.expect("it has one")
}

/// A frame; the rule that decided it.
async fn frame(client: &mut Client, request: wire::SuggestRequest) -> (wire::Trial, Rule) {
    let trial = client.suggest(request).await.expect("a trial").into_inner();
    done(client, &trial.name, 10.0 + trial.name.len() as f64).await;
    let rule = trial.reason.as_ref().and_then(|reason| reason.explanation.as_ref()).map(|one| one.rule());
    (trial, rule.unwrap_or_default())
}

#[tokio::test]
async fn wishes_hold_for_their_session_alone() {
    let (server, mut client) = Server::with_client().await;
    let before = calm(&mut client).await.policy.expect("it has one");
    for number in 0..6 {
        let (trial, rule) = frame(&mut client, explorer(1, Some(WISHES))).await;
        assert_eq!(rule, Rule::Explore, "{number}: {trial:?}");
        let abort_above = trial.abort_above;
        assert_eq!(abort_above.is_some(), trial.mode() == wire::Mode::Explore && number > 0, "{trial:?}");
        let (other, rule) = frame(&mut client, ask("another", 5.0)).await;
        assert!([Rule::Exploit, Rule::Finished].contains(&rule), "{other:?}");
    }
    // Its own limit is reached, which lies above the study's.
    let (trial, _) = frame(&mut client, explorer(1, Some(WISHES))).await;
    assert_ne!(trial.mode(), wire::Mode::Explore, "{trial:?}");
    assert_eq!(policy(&mut client).await, before);
    // The client's next session has no wishes, in the state in which the last one explored.
    let (trial, rule) = frame(&mut client, explorer(2, None)).await;
    assert_eq!(rule, Rule::Finished, "{trial:?}");
    server.stop().await;
}

#[tokio::test]
async fn a_session_outlives_the_daemon() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("studies.db");
    for start in 0..2 {
        let server = Server::on_disk(&path, common::START_MS).await;
        let mut client = server.client().await;
        calm(&mut client).await;
        for _ in 0..2 {
            let (trial, rule) = frame(&mut client, explorer(1, Some(WISHES))).await;
            assert_eq!(rule, Rule::Explore, "start {start}: {trial:?}");
        }
        server.stop().await;
    }
    let server = Server::on_disk(&path, common::START_MS).await;
    let mut client = server.client().await;
    let (trial, rule) = frame(&mut client, explorer(2, None)).await;
    assert_eq!(rule, Rule::Finished, "{trial:?}");
    server.stop().await;
}

#[tokio::test]
async fn a_session_explores_until_its_deadline() {
    let (server, mut client) = Server::with_client().await;
    calm(&mut client).await;
    let explore_until = Some(timestamp_to_wire(common::START_MS + 5_000));
    let wishes = Some(wire::SessionPolicy { explore_until, trials_per_state: Some(100), ..WISHES });
    for second in 0..9 {
        for _ in 0..2 {
            let (trial, rule) = frame(&mut client, explorer(1, wishes)).await;
            let expected = if second < 5 { Rule::Explore } else { Rule::Exploit };
            // In between the incumbent is measured again, to follow the speed of the machine.
            assert!(rule == expected || rule == Rule::Incumbent, "second {second}: {rule:?}, {trial:?}");
        }
        server.clock.advance_ms(1_000);
    }
    // A run that begins now explores.
    let (trial, rule) = frame(&mut client, explorer(2, Some(WISHES))).await;
    assert_eq!(rule, Rule::Finished, "its own limit of six is reached: {trial:?}");
    server.stop().await;
}

#[tokio::test]
async fn wishes_out_of_range_are_refused() {
    let (server, mut client) = Server::with_hall().await;
    let none = wire::SessionPolicy::default();
    for (wishes, field) in [
        (wire::SessionPolicy { epsilon: Some(1.5), ..none }, "epsilon"),
        (wire::SessionPolicy { trials_per_state: Some(-1), ..none }, "trials_per_state"),
        (wire::SessionPolicy { abort_above: Some(0.5), ..none }, "abort_above"),
    ] {
        let answer = client.suggest(explorer(1, Some(wishes))).await;
        assert_refused(answer, Code::InvalidArgument, field);
    }
    server.stop().await;
}

#[tokio::test]
async fn to_create_a_study_anew_says_where_its_policy_differs() {
    let (server, mut client) = Server::with_client().await;
    calm(&mut client).await;
    // This one wants epsilon 1, and says nothing of the rest.
    let again = create(&mut client, "hall").await;
    assert_eq!(again.policy_differs, ["epsilon"]);
    assert_eq!(again.policy.expect("the stored one").epsilon, Some(0.0));
    let request = wire::GetStudyRequest { name: again.name };
    assert!(client.get_study(request).await.expect("there").into_inner().policy_differs.is_empty());
    server.stop().await;
}
