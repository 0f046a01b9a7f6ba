//! Names and constants of glTF.

/// First bytes of a binary glTF.
pub(in crate::files) const MAGIC: &[u8; 4] = b"glTF";

/// The highest degree that the extension knows.
pub(in crate::files) const MAX_DEGREE: usize = 3;

/// Extension of a splat.
pub(in crate::files) const EXTENSION: &str = "KHR_gaussian_splatting";

/// Types of the chunks of a binary glTF.
pub(in crate::files) const JSON_CHUNK: u32 = 0x4e4f_534a;

/// Type of the binary chunk.
pub(in crate::files) const BINARY_CHUNK: u32 = 0x004e_4942;
