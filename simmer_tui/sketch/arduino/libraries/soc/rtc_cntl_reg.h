// The register of an ESP32 that turns its brown-out detector off.
#pragma once
#define RTC_CNTL_BROWN_OUT_REG 0
