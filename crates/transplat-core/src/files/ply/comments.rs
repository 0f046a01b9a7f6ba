//! Comments of trainers in a PLY, and those of files that are written.

use std::io::Write;

use super::header::Header;
use crate::files::written::WritableSplat;
use crate::surfels::UpAxis;

/// As Brush and Postshot write that the opacities were compensated for the low-pass in training.
pub(super) fn says_antialiased(comment: &str) -> bool {
    let lower = comment.to_ascii_lowercase();
    let mut words = lower.split_whitespace();
    matches!(
        (words.next(), words.next()),
        (Some("splatrendermode:"), Some("mip")) | (Some("antialiased"), Some("1"))
    )
}

/// Up axis of its comments.
pub(super) fn up_of(header: &Header) -> Option<UpAxis> {
    (header.comments.iter()).find_map(|comment| up_axis_of(comment))
}

/// `Vertical axis: y` in a comment, as several tools write it.
fn up_axis_of(comment: &str) -> Option<UpAxis> {
    let lower = comment.to_ascii_lowercase();
    let axis = lower.strip_prefix("vertical axis:")?.trim();
    // Without a sign it is the positive one.
    let is_it = |name: &str| name == axis || name.strip_prefix('+') == Some(axis);
    let found = UpAxis::ALL.into_iter().find(|(name, _)| is_it(name));
    found.map(|(_, axis)| axis)
}

/// Writes what is known of a splat beside its surfels.
pub(super) fn write_comments(
    splat: &WritableSplat<'_>,
    out: &mut impl Write,
) -> std::io::Result<()> {
    if let Some(up) = splat.up {
        writeln!(out, "comment Vertical axis: {}", up.name())?;
    }
    if splat.is_antialiased {
        writeln!(out, "comment SplatRenderMode: mip")?;
    }
    Ok(())
}
