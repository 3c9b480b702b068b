// Registers of an ESP32: sketches write that of the brown-out detector, and no supply fails here.
#pragma once
#define WRITE_PERI_REG(address, value) ((void)(address), (void)(value))
