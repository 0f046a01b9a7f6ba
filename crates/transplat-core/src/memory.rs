//! Check for memory before a large splat takes it: a program that is killed for want of it loses its user's work.

use sysinfo::{MemoryRefreshKind, System};

/// Surfels below which memory is not checked.
const FEW: usize = 100_000;

/// Checks that memory has room for so many surfels of so many bytes each.
pub(crate) fn ensure_room(surfels: usize, bytes_each: usize) -> Result<(), String> {
    if surfels < FEW {
        return Ok(());
    }
    free_bytes().map_or(Ok(()), |free| ensure_room_in(free, surfels, bytes_each))
}

fn ensure_room_in(free: u64, surfels: usize, bytes_each: usize) -> Result<(), String> {
    let needed = (surfels as u64).saturating_mul(bytes_each as u64);
    if needed <= free {
        return Ok(());
    }
    let gb = |bytes: u64| bytes as f64 / 1e9;
    Err(format!(
        "its {surfels} splats need {:.1} GB of memory or more, and {:.1} GB are free: close what else is open, or thin it out",
        gb(needed),
        gb(free)
    ))
}

/// Bytes that can still be taken, where the system tells.
fn free_bytes() -> Option<u64> {
    let mut system = System::new().ok()?;
    system.refresh_memory_specifics(MemoryRefreshKind::everything());
    let free = system.available_memory() + system.free_swap();
    // A container may have less than its machine.
    let of_container =
        (system.cgroup_limits()).map(|limits| limits.total_memory.saturating_sub(limits.rss));
    (system.total_memory() > 0).then(|| free.min(of_container.unwrap_or(u64::MAX)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_told_in_gigabytes() {
        assert_eq!(ensure_room_in(6_000_000_000, 5_000_000, 1200), Ok(()));
        let told = ensure_room_in(2_000_000_000, 5_000_000, 1200).expect_err("it is too much");
        assert!(told.contains("5000000 splats need 6.0 GB"), "{told}");
        assert!(told.contains("2.0 GB are free"), "{told}");
    }

    #[test]
    fn a_machine_has_room_for_some_and_not_for_all() {
        assert_eq!(ensure_room(FEW, 100), Ok(()));
        assert!(ensure_room(1 << 40, 1000).is_err());
    }
}
