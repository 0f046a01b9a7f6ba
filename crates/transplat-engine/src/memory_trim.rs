//! Memory trimming: free memory goes back to the system. glibc keeps it, in an arena for each thread that ever asked, and every job brings a pool of
//! new ones.

/// As many arenas as there are cores, instead of eight times as many: to be said before there are threads.
#[allow(unsafe_code)]
pub fn keep_few_arenas() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    if let Ok(cores) = std::thread::available_parallelism().map(|n| n.get().min(1 << 10)) {
        // SAFETY: called before the window's and the pools' threads are there, as it asks.
        unsafe { libc::mallopt(libc::M_ARENA_MAX, cores as libc::c_int) };
    }
}

/// Gives back what is free.
#[allow(unsafe_code)]
pub fn give_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: it takes a number, and may be called at any time from any thread.
    unsafe {
        libc::malloc_trim(0)
    };
}
