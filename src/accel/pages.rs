//! Large arrays on large pages: rays jump about in hundreds of megabytes, and with small pages address translation costs
//! them as much as the loads.

/// An empty vector with room for `capacity` elements, on large pages where the system has them to give.
pub(super) fn with_large_pages<T>(capacity: usize) -> Vec<T> {
    let vector = Vec::with_capacity(capacity);
    #[cfg(target_os = "linux")]
    advise(&vector);
    vector
}

/// Asks for large pages; a refusal changes nothing but the speed.
#[cfg(target_os = "linux")]
fn advise<T>(vector: &Vec<T>) {
    const PAGE: usize = 1 << 21;
    let start = vector.as_ptr() as usize;
    let end = start + vector.capacity() * size_of::<T>();
    let (start, end) = (start.next_multiple_of(PAGE), end / PAGE * PAGE);
    if start < end {
        // SAFETY: the range lies within the vector's own allocation, and the advice leaves its contents alone.
        unsafe { libc::madvise(start as *mut libc::c_void, end - start, libc::MADV_HUGEPAGE) };
    }
}
