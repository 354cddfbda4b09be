#pragma once
// Elementary functions in single precision made of IEEE +, -, *, / and sqrt only, so that every host and every C
// library gives the same bits. Error at most 2 ulp in the ranges that rendering uses (tested against double).
#include <cstdint>

#include "cloudrenderer/math.h"

namespace cloudrenderer::portable {

void sincos(float x, float& s, float& c);  // |x| <= 1e5
float sin(float x);
float cos(float x);
float tan(float x);
float asin(float x);   // argument clamped to [-1, 1]
float acos(float x);
float atan2(float y, float x);
float exp(float x);    // 0 below -104, infinity above 88.8
float exp2(float x);
float log(float x);    // -infinity at 0, NaN below
float log2(float x);
float pow(float x, float y);  // x >= 0; relative error at most 2e-6 for results in [1e-30, 1e30]

// The same in double, for set-up code (tables, transforms): correctly rounded in almost all cases, same bits everywhere.
double sin(double x);
double cos(double x);
double exp(double x);
double log(double x);
double pow(double x, double y);

}  // namespace cloudrenderer::portable
