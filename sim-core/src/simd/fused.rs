//! Scalar code with the fused multiply-add that a processor has: same bits as without.

/// Runs a closure compiled with fused multiply-add where the processor has it: same bits, without a call of the library for each.
/// What it calls takes part if it is inlined.
#[inline(always)]
pub(crate) fn fused<T>(work: impl FnOnce() -> T) -> T {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,fma")]
        fn with_fma<T>(work: impl FnOnce() -> T) -> T {
            work()
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the features that `with_fma` is compiled for were just detected.
            return unsafe { with_fma(work) };
        }
    }
    work()
}
