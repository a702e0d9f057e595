//! `exp2` and `log2` on registers of any width, several at a time, so that a CPU can work on one while it waits for
//! another. The polynomials minimise the largest relative error (Remez).

use pulp::Simd;
use std::f32::consts::LOG2_E;

/// Polynomial in x, coefficients from the lowest power up.
#[inline(always)]
fn polynomial<S: Simd, const N: usize>(simd: S, x: [S::f32s; N], coefficients: &[f32]) -> [S::f32s; N] {
    let (last, lower) = coefficients.split_last().expect("coefficients");
    let mut sum = [simd.splat_f32s(*last); N];
    for coefficient in lower.iter().rev() {
        for i in 0..N {
            sum[i] = simd.mul_add_f32s(sum[i], x[i], simd.splat_f32s(*coefficient));
        }
    }
    sum
}

/// `2^x` for x in [-100, 127], relative error at most 2.5e-7; 2^-100 for smaller x. Products with smaller results would
/// be denormal, which is slow.
#[inline(always)]
pub fn exp2<S: Simd, const N: usize>(simd: S, x: [S::f32s; N]) -> [S::f32s; N] {
    // Fit on [-1/2, 1/2]: error 1.5e-7 with its first coefficient, 1.000_000_07, rounded to 1.
    const FIT: [f32; 6] = [1.0, 0.693_146_97, 0.240_221_2, 0.055_507_133, 0.009_675_542, 0.001_327_647_2];
    // 1.5 * 2^23: adding it rounds a number to an integer, held in the low bits.
    const ROUND: f32 = 12_582_912.0;
    let x = x.map(|x| simd.max_f32s(x, simd.splat_f32s(-100.0)));
    let shifted = x.map(|x| simd.add_f32s(x, simd.splat_f32s(ROUND)));
    let mut fraction = shifted.map(|shifted| simd.sub_f32s(shifted, simd.splat_f32s(ROUND)));
    for i in 0..N {
        fraction[i] = simd.sub_f32s(x[i], fraction[i]);
    }
    let mut power = polynomial(simd, fraction, &FIT);
    for i in 0..N {
        let exponent = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(shifted[i]), simd.splat_u32s(23));
        power[i] = simd.transmute_f32s_u32s(simd.add_u32s(simd.transmute_u32s_f32s(power[i]), exponent));
    }
    power
}

/// `log2(x)` of normal positive x, error at most 5e-7.
#[inline(always)]
pub fn log2<S: Simd, const N: usize>(simd: S, x: [S::f32s; N]) -> [S::f32s; N] {
    // Fit of log2(1 + f) / f for 1 + f in [sqrt(1/2), sqrt(2)]: error 1.7e-7.
    const FIT: [f32; 8] =
        [LOG2_E, -0.721_352_8, 0.480_923_24, -0.360_239_64, 0.287_098_7, -0.248_876_86, 0.234_042_32, -0.145_811_65];
    // Bits of sqrt(1/2). Subtracting them leaves the exponent in the high bits; the low bits, added back, give the
    // mantissa.
    const LOWEST: u32 = 0x3f35_04f3;
    // 2^23: its low bits hold an integer. The offset keeps that integer positive.
    const INTEGER: f32 = 8_388_608.0;
    const OFFSET: u32 = 128;
    let lowest = simd.splat_u32s(LOWEST.wrapping_sub(OFFSET << 23));
    let above = x.map(|x| simd.sub_u32s(simd.transmute_u32s_f32s(x), lowest));
    let f = above.map(|above| {
        let mantissa = simd.add_u32s(simd.and_u32s(above, simd.splat_u32s(0x007f_ffff)), simd.splat_u32s(LOWEST));
        simd.sub_f32s(simd.transmute_f32s_u32s(mantissa), simd.splat_f32s(1.0))
    });
    let mut log = polynomial(simd, f, &FIT);
    for i in 0..N {
        let exponent = simd.wrapping_dyn_shr_u32s(above[i], simd.splat_u32s(23));
        let exponent = simd.transmute_f32s_u32s(simd.or_u32s(exponent, simd.splat_u32s(INTEGER.to_bits())));
        let exponent = simd.sub_f32s(exponent, simd.splat_f32s(INTEGER + OFFSET as f32));
        log[i] = simd.mul_add_f32s(f[i], log[i], exponent);
    }
    log
}
