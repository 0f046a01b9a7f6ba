//! Layout of SOG's images.

/// Name of the file that says what is where.
pub(in crate::files) const META: &str = "meta.json";

/// Palette entries in a row of the picture of higher SH.
pub(in crate::files) const ENTRIES_IN_A_ROW: usize = 64;

/// The alpha of a rotation's pixel is this and the index of its largest component.
pub(in crate::files) const ROTATION_MODE: u8 = 252;

/// Numbers in a codebook.
pub(in crate::files) const CODES: usize = 256;

/// The `meta.json` among the files of an archive: the one that is in the fewest folders.
pub(in crate::files) fn meta_in(names: &[String]) -> Option<String> {
    let is_meta = |name: &&String| name.rsplit('/').next() == Some(META);
    let metas = names.iter().filter(is_meta);
    metas.min_by_key(|name| name.matches('/').count()).cloned()
}
