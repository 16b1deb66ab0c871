//! Any words as the daemon's command line: read or refused.

use treewright_server::config::Cli;

/// Reads the words of a text, parted by spaces.
pub fn run(text: &str) {
    // Names would be looked up on the network.
    if text.contains("listen") {
        return;
    }
    let _ = Cli::read(std::iter::once("treewrightd").chain(text.split(' ')));
}
