// What the kernels between phases and field share: the look-up table's drive, and which half of a pair a sub-frame is.

#include "trig.glsl"

