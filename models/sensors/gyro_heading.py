"""A gyro whose rate is integrated to a heading (KIT 2015, exercise 2)."""

OUTPUTS: dict[str, str] = {"heading": "heading"}
