//! Cache of compiled pipelines from start to start: where a driver keeps none, they take a second each time.

use std::fs;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes before the driver's own: what tells whether those are as they were written.
const HASH_BYTES: usize = size_of::<u64>();

/// Pipelines that a driver compiled, and the file that they are cached in.
#[derive(Debug)]
pub(super) struct KeptPipelines {
    cache: wgpu::PipelineCache,
    file: PathBuf,
    /// Bytes that were read.
    length: usize,
}

impl KeptPipelines {
    /// Reads the cache of an adapter in a folder; none where its driver hands none out.
    #[allow(unsafe_code)]
    pub fn read(adapter: &wgpu::Adapter, device: &wgpu::Device, folder: &Path) -> Option<Self> {
        if !device.features().contains(wgpu::Features::PIPELINE_CACHE) {
            return None;
        }
        let key = wgpu::util::pipeline_cache_key(&adapter.get_info())?;
        // Of another version's pipelines few would be of use.
        let file = folder.join(format!("{key}_{}", env!("CARGO_PKG_VERSION")));
        let data = fs::read(&file).ok().and_then(unpacked);
        let descriptor = wgpu::PipelineCacheDescriptor {
            label: None,
            data: data.as_deref(),
            fallback: true,
        };
        // SAFETY: the data is what `write` got of wgpu, to the last bit; whether it is of this wgpu, adapter and driver, wgpu and the driver see
        // for themselves.
        let cache = unsafe { device.create_pipeline_cache(&descriptor) };
        let length = data.map_or(0, |data| data.len());
        Some(Self {
            cache,
            file,
            length,
        })
    }

    /// For the descriptors of pipelines.
    pub fn cache(&self) -> &wgpu::PipelineCache {
        &self.cache
    }

    /// Where they are kept.
    pub fn folder(&self) -> &Path {
        self.file.parent().unwrap_or(Path::new(""))
    }

    /// Keeps them, if others came to those that were read. Where nothing can be written, nothing is kept.
    pub fn write(&self) {
        // Of a device that is lost there are none.
        let data = self.cache.get_data();
        let Some(data) = data.filter(|data| data.len() != self.length) else {
            return;
        };
        // Whole or not at all, however many write at once.
        static WRITTEN: AtomicUsize = AtomicUsize::new(0);
        let number = WRITTEN.fetch_add(1, Ordering::Relaxed);
        let mut beside = self.file.clone().into_os_string();
        beside.push(format!(".{}-{number}", std::process::id()));
        let beside = PathBuf::from(beside);
        let folder = fs::create_dir_all(self.folder());
        let written = folder.and_then(|()| fs::write(&beside, packed(data)));
        if written
            .and_then(|()| fs::rename(&beside, &self.file))
            .is_err()
        {
            let _ = fs::remove_file(&beside);
        }
    }
}

fn hash_of(data: &[u8]) -> [u8; HASH_BYTES] {
    let mut hasher = DefaultHasher::new();
    data.hash(&mut hasher);
    hasher.finish().to_le_bytes()
}

fn packed(data: Vec<u8>) -> Vec<u8> {
    [&hash_of(&data)[..], &data].concat()
}

/// Unpacks a cache file; none where it was changed since.
fn unpacked(bytes: Vec<u8>) -> Option<Vec<u8>> {
    let (hash, data) = bytes.split_at_checked(HASH_BYTES)?;
    (hash == hash_of(data)).then(|| data.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_changed_is_not_handed_to_a_driver() {
        let data: Vec<u8> = (0..100).collect();
        let mut kept = packed(data.clone());
        assert_eq!(unpacked(kept.clone()), Some(data));
        assert_eq!(unpacked(kept[..50].to_vec()), None);
        assert_eq!(unpacked(vec![1, 2, 3]), None);
        kept[60] ^= 1;
        assert_eq!(unpacked(kept), None);
    }
}
