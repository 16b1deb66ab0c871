//! The renderer's program; everything is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    treewright_render_cli::main()
}
