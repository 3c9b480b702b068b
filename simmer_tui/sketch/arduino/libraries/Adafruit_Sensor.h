// What sensors of Adafruit's libraries have in common: events, in units of the SI.
#pragma once
#include "../core/Arduino.h"

#define SENSORS_GRAVITY_EARTH (9.80665F)
#define SENSORS_GRAVITY_STANDARD (SENSORS_GRAVITY_EARTH)
#define SENSORS_DPS_TO_RADS (0.017453293F)
#define SENSORS_RADS_TO_DPS (57.29577793F)

typedef enum {
  SENSOR_TYPE_ACCELEROMETER = 1,
  SENSOR_TYPE_GYROSCOPE = 4,
  SENSOR_TYPE_AMBIENT_TEMPERATURE = 13
} sensors_type_t;

struct sensors_vec_t {
  union {
    float v[3];
    struct {
      float x, y, z;
    };
  };
};

struct sensors_event_t {
  int32_t sensor_id, type;
  int32_t timestamp;  // milliseconds
  union {
    float data[4];
    sensors_vec_t acceleration;  // m/s^2
    sensors_vec_t gyro;          // rad/s
    float temperature;           // degrees C
  };
};

struct sensor_t {
  char name[12];
  int32_t sensor_id, type;
  float max_value, min_value, resolution;
  int32_t min_delay;  // microseconds
};

class Adafruit_Sensor {
 public:
  virtual ~Adafruit_Sensor() = default;
  virtual bool getEvent(sensors_event_t* event) = 0;
  virtual void getSensor(sensor_t* sensor) = 0;
};
