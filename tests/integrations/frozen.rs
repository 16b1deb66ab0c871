//! A frozen study answers what ran, whichever language asks. A program of the language runs a frame for each
//! size that it is given, and prints the size, leaf and window of each, and whether it ran.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use treewright_client::blocking::Client;
use treewright_client::{Operation, Options, Policy, PolicyChange};

use crate::support::succeed;

/// Leaf and window.
type Settings = (i64, i64);

const DEFAULT: Settings = (8, 8);

struct Frame {
    size: i64,
    settings: Settings,
    works: bool,
}

fn frames(program: &dyn Fn() -> Command, url: &str, sizes: &[i64]) -> Vec<Frame> {
    let said = succeed(program().arg(url).args(sizes.iter().map(i64::to_string)));
    let frame = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        let number = |place: usize| words[place].parse::<i64>().expect("a number");
        Frame { size: number(0), settings: (number(1), number(2)), works: words[3] == "ran" }
    };
    let frames: Vec<Frame> = said.lines().map(frame).collect();
    assert_eq!(frames.len(), sizes.len(), "{said}");
    frames
}

/// Tunes two sizes, freezes the study, and asks for both again: what ran there. For a third, where nothing
/// did, what ran for another, or the default.
pub(crate) fn answers_what_ran(url: &str, program: &dyn Fn() -> Command) {
    let tuned: Vec<i64> = (0..40).map(|frame| if frame % 4 == 3 { 90 } else { 10 }).collect();
    let (mut ran, mut failed) = (BTreeMap::<i64, BTreeSet<Settings>>::new(), BTreeSet::new());
    for Frame { size, settings, works } in frames(program, url, &tuned) {
        let book = if works { ran.entry(size).or_default() } else { &mut failed };
        book.insert(settings);
    }
    assert!(ran[&10].len() > 4 && !failed.is_empty(), "ran: {ran:?}, failed: {failed:?}");
    let client = Client::connect(url, Options::new()).expect("a client");
    let freeze = PolicyChange::set(Policy::new().operation(Operation::Freeze));
    client.update_policy("frozen", &freeze).expect("it is frozen");
    let elsewhere: BTreeSet<Settings> = ran.values().flatten().copied().chain([DEFAULT]).collect();
    for Frame { size, settings, .. } in frames(program, url, &[10, 10, 10, 90, 90, 90, 50, 50, 50]) {
        let known = ran.get(&size).unwrap_or(&elsewhere);
        assert!(known.contains(&settings), "{settings:?} was never run at {size}: {known:?}");
        assert!(!failed.contains(&settings), "{settings:?} cannot be used");
    }
}
