//! A kernel on the instruction set that is asked for.

/// Makes a function that runs a kernel, generic over [`Lanes`](crate::simd::Lanes), on the instruction set that its first
/// argument names. The kernel is compiled once for each of them.
///
/// `on_isa! { fn sum_with_isa = sum(a: &[f32]) -> f32 }` makes `fn sum_with_isa(isa: Isa, a: &[f32]) -> f32`, which calls
/// `sum::<Avx512>(a)`, `sum::<Avx2>(a)` or `sum::<Portable>(a)`. Kernels are `#[inline(always)]`, so that they take over the
/// features of the function that calls them.
#[macro_export]
macro_rules! on_isa {
    (
        $(#[$meta:meta])*
        fn $name:ident = $kernel:ident($($argument:ident: $type:ty),* $(,)?) $(-> $out:ty)?
    ) => {
        $(#[$meta])*
        fn $name(isa: $crate::simd::Isa, $($argument: $type),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,fma")]
            fn avx512($($argument: $type),*) $(-> $out)? {
                $kernel::<$crate::simd::Avx512>($($argument),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($argument: $type),*) $(-> $out)? {
                $kernel::<$crate::simd::Avx2>($($argument),*)
            }
            match isa {
                #[cfg(target_arch = "x86_64")]
                // SAFETY: worlds and poses are only made with an instruction set that the processor has.
                $crate::simd::Isa::Avx512 => unsafe { avx512($($argument),*) },
                #[cfg(target_arch = "x86_64")]
                // SAFETY: worlds and poses are only made with an instruction set that the processor has.
                $crate::simd::Isa::Avx2 => unsafe { avx2($($argument),*) },
                _ => $kernel::<$crate::simd::Portable>($($argument),*),
            }
        }
    };
}
pub use on_isa;
