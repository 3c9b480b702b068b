// FreeRTOS for AVR boards: its scheduler starts after setup(), and its idle task calls loop().
#pragma once
#include "freertos/FreeRTOS.h"
#include "freertos/task.h"
