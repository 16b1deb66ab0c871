//! Ctrl-C: the first asks for a polite end, the second ends at once.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Whether the user asked the program to stop.
#[derive(Clone, Copy, Debug)]
pub struct Interrupt(());

impl Interrupt {
    /// Begins to listen for SIGINT and SIGTERM, which end the program at once if that is not possible.
    pub fn listen() -> Self {
        static LISTENING: OnceLock<()> = OnceLock::new();
        LISTENING.get_or_init(|| {
            let handler = || {
                if REQUESTED.swap(true, Ordering::Relaxed) {
                    std::process::exit(130);
                }
            };
            if let Err(error) = ctrlc::set_handler(handler) {
                tracing::warn!("Ctrl-C will not be handled politely: {error}");
            }
        });
        Self(())
    }

    /// Whether to stop after the current frame.
    pub fn requested(self) -> bool {
        REQUESTED.load(Ordering::Relaxed)
    }
}
