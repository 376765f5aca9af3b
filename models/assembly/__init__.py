"""Put a model together from the files of a vehicle, its tyres, effects and sensors."""
