//! One sample of a picture: tiles are handed to threads, each works its tiles off in one of two ways.

use std::sync::{Mutex, PoisonError};
use std::{cell::RefCell, time::Instant};

use treewright_accel::Intersector;

use super::stages::{self, Buffers};
use super::{Counts, View, frame::Frame, needs::Needs, path, prepared::Prepared};
use crate::film::{Film, Tile};
use crate::render_options::RenderOptions;

thread_local! {
    /// Kept from frame to frame.
    static BUFFERS: RefCell<Buffers> = RefCell::default();
}

/// Adds one sample to each pixel of the film, as its next one, on the rayon pool it is called in.
/// `needs` are those of the scene, or more, which changes no picture.
///
/// No tile begins after `until`. Returns whether there was time for all tiles; a film that lacks some is of
/// no use until it is cleared.
///
/// # Panics
/// If `needs` do not cover those of the scene.
pub fn render_sample<I: Intersector>(
    prepared: &Prepared,
    intersector: &I,
    view: &View,
    options: &RenderOptions,
    needs: Needs,
    film: &mut Film,
    until: Option<Instant>,
) -> (Counts, bool) {
    assert!(needs.covers(prepared.needs), "the kernel must be able to do what the scene needs");
    let frame = Frame::new(prepared, view, needs, film);
    // Tiles differ in cost tenfold, so each thread fetches the next: one uncontended lock a tile.
    let tiles = Mutex::new(film.tiles(options.tile()).into_iter());
    let is_late = || until.is_some_and(|until| Instant::now() >= until);
    let next = || tiles.lock().unwrap_or_else(PoisonError::into_inner).next();
    let counts = rayon::broadcast(|_| {
        let mut counts = Counts::default();
        BUFFERS.with_borrow_mut(|buffers| {
            while !is_late()
                && let Some(mut tile) = next()
            {
                if options.staged {
                    let bounces = options.bounce_flight;
                    stages::render(&frame, intersector, bounces, buffers, &mut tile, &mut counts);
                } else {
                    path_by_path(&frame, intersector, &mut tile, &mut counts);
                }
            }
        });
        counts
    });
    let is_whole = next().is_none();
    drop(tiles);
    if is_whole {
        film.count_sample();
    }
    let counts = counts.into_iter().fold(Counts::default(), |mut sum, counts| {
        sum += counts;
        sum
    });
    (counts, is_whole)
}

fn path_by_path<I: Intersector>(
    frame: &Frame<'_>,
    intersector: &I,
    tile: &mut Tile<'_>,
    counts: &mut Counts,
) {
    for pixel in 0..tile.sums.len() {
        if let Some((path, ray)) = frame.begin(tile, pixel as u32) {
            let radiance = path::radiance(frame, intersector, path, ray, counts);
            counts.add_sample(&mut tile.sums[pixel], radiance);
        }
    }
}
