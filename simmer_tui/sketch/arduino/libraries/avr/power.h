// Parts of the chip that a sketch turns off: they go on here.
#pragma once

enum clock_div_t { clock_div_1 = 0 };
inline void clock_prescale_set(clock_div_t) {}
inline void power_all_enable() {}
inline void power_adc_enable() {}
inline void power_adc_disable() {}
inline void power_spi_enable() {}
inline void power_spi_disable() {}
