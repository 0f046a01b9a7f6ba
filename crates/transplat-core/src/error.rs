//! Errors of files and requests, with what to do next.

use std::path::{Path, PathBuf};

/// An error of the core: which file (where there is one), what is wrong, what would be right.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused to read or write.
    #[error("{}: {}", refusal(reason), path.display())]
    Io {
        /// The file that was read or written.
        path: PathBuf,
        /// Reason of the system.
        reason: std::io::Error,
    },
    /// The file was read, and what it holds is not what its kind of file must hold.
    #[error("{message}: {}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Problem, and what would be accepted.
        message: String,
    },
    /// Two inputs do not belong together, or a setting is out of range.
    #[error("{0}")]
    Mismatch(String),
    /// The caller's progress callback asked to stop.
    #[error("cancelled")]
    Cancelled,
}

/// `Result` with the core's [`enum@Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Explains a refusal of the system in plain words, with what to do and without its numbers.
pub fn refusal(reason: &std::io::Error) -> String {
    use std::io::ErrorKind;
    match reason.kind() {
        ErrorKind::NotFound => "there is no such file or folder".into(),
        ErrorKind::PermissionDenied => {
            "not allowed to read or write this; change its permissions, or choose another place"
                .into()
        }
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            "no room is left on the disk; make room, or choose another place".into()
        }
        ErrorKind::FileTooLarge => "larger than this disk or user may have a file".into(),
        ErrorKind::ReadOnlyFilesystem => "on a disk that is only read; choose another place".into(),
        ErrorKind::NotADirectory => "a part of this path is a file, not a folder".into(),
        ErrorKind::IsADirectory => "is a directory where a file is expected".into(),
        ErrorKind::UnexpectedEof => "the file ends too early: it is truncated".into(),
        ErrorKind::InvalidFilename => "no file can be called like this".into(),
        // Not the system's words.
        _ if reason.raw_os_error().is_none() => reason.to_string(),
        _ => {
            let said = reason.to_string();
            let number = said.find(" (os error").unwrap_or(said.len());
            format!("the system refuses: {}", said[..number].to_lowercase())
        }
    }
}

/// Checks a condition: an [`Error::Mismatch`] where it does not hold.
pub(crate) fn ensure(holds: bool, otherwise: impl FnOnce() -> String) -> Result<()> {
    if holds {
        Ok(())
    } else {
        Err(Error::Mismatch(otherwise()))
    }
}

impl Error {
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |reason| Self::Io {
            path: path.to_owned(),
            reason,
        }
    }

    pub(crate) fn invalid(path: &Path, message: impl Into<String>) -> Self {
        Self::Invalid {
            path: path.to_owned(),
            message: message.into(),
        }
    }
}
