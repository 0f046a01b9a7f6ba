//! Real spherical harmonics to degree 8, with the Condon-Shortley sign.
//!
//! Coefficient `i = l(l+1) + m` of band `l`; band 1 is `(-C1 y, C1 z, -C1 x)` with `C1 = sqrt(3/4pi)`, as every splat trainer stores it.
//! Everything that a stage does to an SH vector is here once: the basis, rotation and reflection, the product of two
//! functions, the convolution with the clamped cosine, and the quadratures on which all of them are exact.

mod bands;
mod basis;
mod product;
mod quadrature;
mod rotation;
mod shared;

pub use bands::{
    MAX_COEFFICIENTS, MAX_DEGREE, SQRT_4PI, band, band_of, coefficient_count, cosine_kernel,
    with_degree,
};
pub use basis::{BasisConstants, Real, basis_constants, evaluate_basis, evaluate_sh};
pub use product::{LightOperator, light_operator, triple_product_tensor};
pub(crate) use quadrature::gauss_legendre;
pub use quadrature::{fibonacci_sphere, lattice, refining_order, sphere_quadrature};
pub use rotation::{ExchangeEntry, Mirror, exchange_yz, rotate_coefficients, rotate_functions};
pub use shared::SharedSh;
