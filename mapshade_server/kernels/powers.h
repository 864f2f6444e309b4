// Powers that are the same bits on every machine: IEEE additions, multiplications and divisions only, no libm.
#pragma once

namespace volsplat {

// The logarithm to base 2 of a positive, finite number; relative error below 1e-15.
double log2_exactly(double x);

// 2^x; 0 below the range of float64, relative error below 1e-15.
double exp2_exactly(double x);

// base^exponent for base >= 0 and a finite exponent > 0; relative error below 1e-13 for exponents up to 1000.
double power(double base, double exponent);

}  // namespace volsplat
