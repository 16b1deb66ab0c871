//! Any text as a filter, an order and a page token: parsed or refused, and evaluated without a panic.

use std::sync::LazyLock;

use crate::example;
use treewright_core::trial::RawTrial;
use treewright_core::tuner::Tuner;
use treewright_server::convert::{from_proto, names};
use treewright_store::cursor::Cursor;
use treewright_store::filter::{Filter, Order};
use treewright_store::{MemoryStore, Store as _};

static TRIAL: LazyLock<RawTrial> = LazyLock::new(|| {
    let spec = from_proto::study(example::study()).expect("a valid study");
    let ask = from_proto::suggest(example::suggest("c")).expect("a valid question").ask;
    let store = MemoryStore::new();
    let runtime = tokio::runtime::Builder::new_current_thread().build().expect("a runtime");
    runtime.block_on(async {
        store.create_study("s", &spec, 0).await.expect("an empty store");
        let fence = store.load("s").await.expect("it is there").fence;
        let mut tuner = Tuner::new(spec.into()).expect("a valid study");
        let (_, change) = tuner.suggest(&ask, 0).expect("a trial");
        store.commit(&fence, &[change]).durable().await.expect("it is stored");
        store.get_trial("s", 1).await.expect("it is there")
    })
});

/// Parses a text as each of the languages that requests carry.
pub fn run(text: &str) {
    if let Ok(filter) = Filter::parse(text) {
        let _ = filter.matches(&TRIAL);
    }
    if let Ok(order) = Order::parse(text) {
        let place = order.place(&*TRIAL);
        assert!(order.compare(&place, &place).is_eq());
        let token = place.token(&["q"]);
        assert_eq!(Cursor::parse(&token, &["q"]), Ok(Some(place)));
    }
    let _ = Cursor::parse(text, &["q"]);
    let _ = names::trial("trial", text);
    let _ = names::study("study", text);
}
