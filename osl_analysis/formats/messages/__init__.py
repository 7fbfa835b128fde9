"""Messages of a log, as ROS 2 CDR, protobuf or JSON: their numbers as columns."""
