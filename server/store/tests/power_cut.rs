//! Power cuts under SQLite's own writer: any part of the writes since the last acknowledgement may be on the
//! disk. All acknowledged commits are there afterwards, and of the others whole ones in their order.
//!
//! The writer's files are copied whenever all that it was given is acknowledged, and so synced. Some of the
//! sectors by which the next copy's log differs are laid over the one before: the first few, any of them, or
//! a garbled one. A disk that reorders its writes between two syncs may hold this. Writes before a sync come
//! before those after it: the header of a restarted log comes before the rest. `tests/end_to_end/power.rs`
//! checks that SQLite asks for the syncs.

mod common;

use std::path::Path;

use common::{change, open, spec};
use treewright_core::tuner::Checkpoint;
use treewright_store::{Fence, Receipt, SqliteStore, Store};

/// The least that a disk writes at once.
const SECTOR: usize = 512;
/// Of SQLite's log.
const HEADER: usize = 32;
/// Trials of each commit: all of them are there, or none.
const TRIALS_PER_COMMIT: u64 = 2;

/// Random numbers (SplitMix64; Steele, Lea, Flood, 2014).
struct Dice(u64);

impl Dice {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % end as u64) as usize
    }

    fn one_in(&mut self, count: usize) -> bool {
        self.below(count) == 0
    }
}

/// The contents of the disk.
#[derive(Clone)]
struct Image {
    file: Vec<u8>,
    log: Vec<u8>,
}

impl Image {
    fn read(database: &Path) -> Self {
        let log = std::fs::read(database.with_extension("db-wal")).expect("a log");
        Self { file: std::fs::read(database).expect("a file"), log }
    }

    fn write(&self, database: &Path) {
        std::fs::write(database, &self.file).expect("a copy");
        std::fs::write(database.with_extension("db-wal"), &self.log).expect("a copy");
        let _ = std::fs::remove_file(database.with_extension("db-shm"));
    }

    fn restarts_log(&self, before: &Self) -> bool {
        self.log.get(..HEADER) != before.log.get(..HEADER)
    }
}

/// Lays a part of the writes between two images over the first.
fn torn(before: &Image, after: &Image, dice: &mut Dice) -> Image {
    let mut image = before.clone();
    let mut begin = 0;
    if after.restarts_log(before) {
        // SQLite syncs the header before it writes more.
        let written = dice.below(2 * HEADER).min(HEADER);
        overlay(&mut image.log, &after.log, 0, written);
        if written < HEADER {
            return image;
        }
        begin = HEADER;
    }
    let differs = |&at: &usize| after.log.get(at..end(at, after)) != before.log.get(at..end(at, after));
    let changed: Vec<usize> =
        std::iter::once(begin).chain((SECTOR..after.log.len()).step_by(SECTOR)).filter(differs).collect();
    let (in_order, last) = (dice.one_in(2), dice.below(changed.len() + 1));
    for (place, &at) in changed.iter().enumerate() {
        let is_written = if in_order { place < last } else { !dice.one_in(8) };
        if is_written {
            overlay(&mut image.log, &after.log, at, end(at, after));
        } else if in_order && place == last {
            // The power went while this sector was written.
            let cut = at + dice.below(end(at, after) - at);
            overlay(&mut image.log, &after.log, at, cut);
        }
    }
    if !changed.is_empty() && dice.one_in(4) {
        let sector = changed[dice.below(changed.len())];
        // A disk does not change unwritten sectors: SQLite relies on that.
        let is_new = |&at: &usize| after.log.get(at) != before.log.get(at);
        if let Some(byte) = (sector..end(sector, after)).find(is_new).and_then(|at| image.log.get_mut(at)) {
            *byte ^= 0xa5;
        }
    }
    image
}

/// The end of the sector of a byte.
fn end(at: usize, image: &Image) -> usize {
    (at / SECTOR * SECTOR + SECTOR).min(image.log.len())
}

fn overlay(log: &mut Vec<u8>, from: &[u8], begin: usize, end: usize) {
    if log.len() < end {
        log.resize(end, 0);
    }
    log[begin..end].copy_from_slice(&from[begin..end]);
}

/// A writer that is given commits and something large.
struct Writer {
    store: SqliteStore,
    fence: Fence,
    last_trial: u64,
}

impl Writer {
    async fn create(database: &Path) -> Self {
        let store = SqliteStore::open(database).await.expect("a new database");
        store.create_study("hall", &spec(), 5).await.expect("stored");
        let fence = store.load("hall").await.expect("loaded").fence;
        Self { store, fence, last_trial: 0 }
    }

    fn commit(&mut self) -> Receipt {
        let numbers = self.last_trial + 1..=self.last_trial + TRIALS_PER_COMMIT;
        self.last_trial += TRIALS_PER_COMMIT;
        self.store.commit(&self.fence, &[change(numbers.map(open).collect())])
    }

    /// Some commits at once, some of which share a transaction, or something large, so that the log is
    /// sometimes merged into the file and restarted. Returns once all is acknowledged.
    async fn work(&mut self, dice: &mut Dice) {
        if dice.one_in(2) {
            let checkpoint = Checkpoint { completion: self.last_trial, bytes: vec![7; 200_000] };
            return self.store.save_checkpoint(&self.fence, &checkpoint).await.expect("written");
        }
        let receipts: Vec<Receipt> = (0..=dice.below(6)).map(|_| self.commit()).collect();
        for receipt in receipts {
            receipt.durable().await.expect("written");
        }
    }
}

/// The number of stored trials. Checks that they are the first ones, and that the store goes on.
async fn trials_of(database: &Path) -> u64 {
    let store = SqliteStore::open(database).await.expect("a sound file");
    let loaded = store.load("hall").await.expect("the study");
    let there: Vec<u64> = loaded.open_trials.iter().map(|trial| trial.number).collect();
    let count = there.len() as u64;
    assert_eq!(there, (1..=count).collect::<Vec<_>>(), "no hole");
    assert_eq!(loaded.snapshot.last_trial, count);
    assert_eq!(count % TRIALS_PER_COMMIT, 0, "no half of a commit");
    store.commit(&loaded.fence, &[change(vec![open(count + 1)])]).durable().await.expect("it goes on");
    store.close().await;
    count
}

/// Cuts the power now and then, and whenever the log is restarted, until that was seen twice. Returns the
/// number of cuts that lost something.
async fn cuts(seed: u64) -> u32 {
    let mut dice = Dice(seed);
    let folder = tempfile::tempdir().expect("a folder");
    let (database, after_cut) = (folder.path().join("studies.db"), folder.path().join("cut.db"));
    let mut writer = Writer::create(&database).await;
    let mut before = Image::read(&database);
    let (mut round, mut restarts, mut lost) = (0, 0, 0);
    while restarts < 2 {
        round += 1;
        assert!(round < 2000, "the log is never begun again");
        let acknowledged = writer.last_trial;
        writer.work(&mut dice).await;
        let after = Image::read(&database);
        // Where the log was merged into the file meanwhile, its former contents are gone.
        let is_seen = after.file == before.file;
        let is_restart = is_seen && after.restarts_log(&before);
        restarts += u32::from(is_restart);
        let cuts = if is_restart { 6 } else { usize::from(is_seen && dice.one_in(3)) };
        for _ in 0..cuts {
            torn(&before, &after, &mut dice).write(&after_cut);
            let there = trials_of(&after_cut).await;
            let expected = acknowledged..=writer.last_trial;
            assert!(expected.contains(&there), "seed {seed}, round {round}: {there}, not {expected:?}");
            lost += u32::from(there < writer.last_trial);
        }
        before = after;
    }
    writer.store.close().await;
    lost
}

#[tokio::test]
async fn after_a_power_cut_everything_acknowledged_is_there_and_the_rest_in_order() {
    let mut lost = 0;
    for seed in 0..3 {
        lost += cuts(seed).await;
    }
    assert!(lost > 0, "no cut reached what was not acknowledged yet");
}
