//! The failures of commands, with an exit code for scripts.

use std::process::ExitCode;

use treewright_accel::{BuildError, DeviceError};
use treewright_client::ClientError;

use treewright_renderer::{frame::RendererError, image_file::ImageFileError, space::ConfigurationError};
use treewright_scene::SceneError;

/// A [`CliError`] unless another error is named.
pub type Result<T, E = CliError> = std::result::Result<T, E>;

/// Why a command ended without success.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// The operation failed. Exit code 1.
    #[error("{0}")]
    Failed(String),
    /// The command line makes no sense. Exit code 2, as for mistakes that clap finds.
    #[error("{0}")]
    Usage(String),
    /// The daemon cannot be reached. Exit code 3.
    #[error("{0}")]
    Unreachable(String),
    /// Ctrl-C. Exit code 130, as shells expect it.
    #[error("stopped by the user")]
    Interrupted,
}

impl CliError {
    /// The process's exit code.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::Failed(_) => 1,
            Self::Usage(_) => 2,
            Self::Unreachable(_) => 3,
            Self::Interrupted => 130,
        })
    }
}

impl From<ClientError> for CliError {
    fn from(error: ClientError) -> Self {
        match error {
            ClientError::BadUrl { .. } | ClientError::Invalid { .. } => Self::Usage(error.to_string()),
            _ if error.is_unreachable() => Self::Unreachable(error.to_string()),
            _ => Self::Failed(error.to_string()),
        }
    }
}

impl From<ConfigurationError> for CliError {
    fn from(error: ConfigurationError) -> Self {
        Self::Usage(error.to_string())
    }
}

macro_rules! failed {
    ($($error:ty),*) => {$(
        impl From<$error> for CliError {
            fn from(error: $error) -> Self {
                Self::Failed(error.to_string())
            }
        }
    )*};
}

failed!(SceneError, ImageFileError, RendererError, BuildError, DeviceError);

/// Writes a file, or says which and why not.
pub fn write_file(path: &std::path::Path, bytes: &[u8]) -> Result<()> {
    std::fs::write(path, bytes)
        .map_err(|error| CliError::Failed(format!("{} cannot be written: {error}", path.display())))
}

/// Checks that the folder of a file exists, before minutes go into its contents.
pub fn check_folder(path: &std::path::Path) -> Result<()> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => Err(CliError::Failed(format!(
            "{}: the folder {} does not exist; create it first",
            path.display(),
            folder.display()
        ))),
        _ => Ok(()),
    }
}
