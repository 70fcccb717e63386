#include "format/quantize.h"
