//! After `kill -9` in mid-run the search goes on where it stood.

use std::collections::BTreeSet;

use crate::site::Site;
use crate::wire;

const TRIALS: usize = 40;

/// The configurations that one client is handed over a whole search, the daemon being killed before
/// each of the given trials: after it was reported, or while it is out.
async fn configurations(kill_before: &[usize], kill_while_open: &[usize]) -> Vec<String> {
    let mut site = Site::new();
    let mut client = wire::connect(site.url()).await;
    let study = wire::create(&mut client, "restart").await;
    let mut seen = Vec::new();
    for number in 0..TRIALS {
        if kill_before.contains(&number) {
            site = site.killed();
            client = wire::connect(site.url()).await;
        }
        let mut trial =
            client.suggest(wire::suggestion(&study, "one", 0.5)).await.expect("a trial").into_inner();
        if kill_while_open.contains(&number) {
            site = site.killed();
            client = wire::connect(site.url()).await;
            let again =
                client.suggest(wire::suggestion(&study, "one", 0.5)).await.expect("a trial").into_inner();
            assert_eq!(again.name, trial.name, "a client that comes back gets its open trial again");
            trial = again;
        }
        seen.push(wire::text(trial.configuration.as_ref().expect("a configuration")));
        client.report(wire::report(&trial)).await.expect("the report is taken");
    }
    seen
}

#[tokio::test]
async fn the_search_resumes_at_the_same_point_after_kill_9() {
    let undisturbed = configurations(&[], &[]).await;
    assert!(undisturbed.iter().collect::<BTreeSet<_>>().len() > TRIALS / 2, "the search does search");
    assert_eq!(configurations(&[1, 9, 20, 33], &[0, 12, 27]).await, undisturbed);
}
