//! All instruction sets move and sum the same way.

use super::*;

fn numbers(seed: f32) -> F32x16 {
    F32x16(std::array::from_fn(|i| {
        (seed * 37.0 + i as f32 * 1.7).sin() * 3.0
    }))
}

/// Every operation once, as bits.
fn exercise<V: Lanes>() -> Vec<u32> {
    let rows: [F32x16; LANES] = std::array::from_fn(|i| numbers(i as f32));
    let v: [V; LANES] = std::array::from_fn(|i| V::load(&rows[i]));
    let mut results = vec![
        v[0] + v[1],
        v[0] - v[1],
        v[0] * v[1],
        v[0] / v[1],
        -v[0],
        v[0].mul_add(v[1], v[2]),
        v[0].abs().sqrt(),
        v[0].abs().ln(),
        v[0].exp(),
        v[0].min(v[1]),
        v[0].max(v[1]),
        V::select(v[0].lt(v[1]), v[2], v[3]),
        V::select(!v[0].lt(v[1]) & v[1].lt(v[2]) | v[3].lt(v[4]), v[2], v[3]),
        V::broadcast(rows[3].0[5]),
        V::splat(0.1),
        v[5].spread(),
        v[5].fourth(),
        v[5].larger_magnitude(v[6]),
        V::broadcast(f32::NAN).larger_magnitude(v[6]),
        V::sum_quarters([v[0], v[1], v[2], v[3]]),
        v[0].shift_in_quarters::<1>(v[1]),
        v[0].shift_in_quarters::<2>(v[1]),
        v[0].shift_in_quarters::<3>(v[1]),
        v[0].shift_quarters::<1>(v[1]),
        v[0].shift_quarters::<2>(v[1]),
        v[0].shift_quarters::<3>(v[1]),
        // SAFETY: one element is 16 floats long.
        unsafe { V::repeat_quarter(rows[7].0.as_ptr().add(3)) },
        // SAFETY: two neighbouring elements are 32 floats long.
        unsafe { V::load_at(rows.as_ptr().cast::<f32>().add(9)) },
    ];
    results.extend(V::transpose_quarters([v[0], v[1], v[2], v[3]]));
    results.extend(V::transpose(&rows));
    let mut bits = vec![
        V::mask_bits(v[0].lt(v[1])),
        u32::from(V::any(v[0].lt(v[1]))),
    ];
    for result in results {
        let mut lanes = [0; LANES];
        result.store_bits(&mut lanes);
        bits.extend(lanes);
    }
    bits
}

#[test]
fn portable_shuffles_do_what_their_names_say() {
    let rows: [F32x16; LANES] =
        std::array::from_fn(|r| F32x16(std::array::from_fn(|i| (100 * r + i) as f32)));
    let lanes = |v: Portable| {
        let mut out = F32x16::ZERO;
        v.store(&mut out);
        out.0
    };
    let v = |r: usize| Portable::load(&rows[r]);
    for (r, row) in Portable::transpose(&rows).into_iter().enumerate() {
        assert_eq!(lanes(row), std::array::from_fn(|i| (100 * i + r) as f32));
    }
    let quads = Portable::transpose_quarters([v(0), v(1), v(2), v(3)]);
    // Lane 4 q + r = 4 * 2 + 1 = 9 of the four arguments.
    assert_eq!(lanes(quads[1])[8..12], [9.0, 109.0, 209.0, 309.0]);
    assert_eq!(lanes(v(0).spread())[4..9], [5.0, 5.0, 5.0, 5.0, 10.0]);
    assert_eq!(
        lanes(v(0).shift_in_quarters::<3>(v(1)))[4..8],
        [7.0, 104.0, 105.0, 106.0]
    );
    assert_eq!(
        lanes(v(0).shift_quarters::<1>(v(1)))[10..14],
        [14.0, 15.0, 100.0, 101.0]
    );
    assert_eq!(
        lanes(Portable::sum_quarters([v(0), v(1), v(2), v(3)]))[4],
        100.0 + 104.0 + 108.0 + 112.0
    );
}

#[cfg(target_arch = "x86_64")]
#[test]
fn instruction_sets_agree_bit_for_bit() {
    let expected = exercise::<Portable>();
    if Isa::Avx512.is_available() {
        assert_eq!(exercise::<Avx512>(), expected);
    }
    if Isa::Avx2.is_available() {
        assert_eq!(exercise::<Avx2>(), expected);
    }
}

#[test]
fn instruction_sets_are_found_by_name() {
    for isa in Isa::ALL {
        assert_eq!(isa.to_string().parse(), Ok(isa));
    }
    let error = "neon".parse::<Isa>().expect_err("not one of them");
    assert!(error.to_string().contains("neon"));
}
