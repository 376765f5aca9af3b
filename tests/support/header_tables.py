"""Headers as loggers, buses and papers write them, for ``support.headers``.

Each log is a title with its rate in Hz (20 where none is said) and its columns as ``name = quantity unit``; a minus
says that the column counts the other way. ``HELD_OUT`` was written before the code that reads names and not used while
that was built; when first read, 80 % of its answers were right, 16 % left out, 4 % wrong. What that showed was mended,
and ``FRESH`` written before: 92 % right, 8 % left out, one of 450 wrong when first read.
"""

DEVELOPED = r"""
# J1939 with an engine
Timestamp = t s; EEC1.EngineSpeed = engine rpm; CCVS1.WheelBasedVehicleSpeed = v km/h; VDC2.SteerWheelAngle = swa rad;
VDC2.YawRate = r rad/s
VDC2.LatAcceleration = ay m/s2; VDC2.LongAcceleration = ax m/s2
# J1939, engine first, only the bus
Timestamp = t s; EngineSpeed = engine rpm; FanSpeed = fan rpm; WheelBasedVehicleSpeed = v km/h;
FrontAxleSpeed = vx km/h; TransInputShaftSpeed = shaft rpm; YawRate (rad/s) = r rad/s
# Miles per hour and Gs
Time (s) = t s; Speed (MPH) = v mph; Steering Angle (deg) = swa deg; Yaw Rate (deg/s) = r deg/s; Lateral Gs = ay g;
Inline Gs = ax g
# OBD dongle @ 2
time = t s; Engine RPM = engine rpm; Vehicle speed (km/h) = v km/h; Engine coolant temperature (C) = temp 1;
Throttle position (%) = percent 1
Latitude = lat deg; Longitude = lon deg
# Chrysler by opendbc
ts = t s; SPEED_1.SPEED_LEFT = wfl m/s; SPEED_1.SPEED_RIGHT = wfr m/s; ESP_8.VEHICLE_SPEED = v m/s;
STEERING.STEER_ANGLE = swa deg
STEERING.STEERING_RATE = swr deg/s; ESP_4.YAW_RATE = r deg/s; ESP_4.LATERAL_ACCEL = ay m/s2;
ESP_4.LONG_ACCEL = ax m/s2; ECM_1.ENGINE_RPM = engine rpm
# Toyota by opendbc
time = t s; SPEED.SPEED = v km/h; STEER_ANGLE_SENSOR.STEER_ANGLE = swa deg; STEER_ANGLE_SENSOR.STEER_RATE = swr deg/s;
KINEMATICS.YAW_RATE = r deg/s
KINEMATICS.ACCEL_Y = ay m/s2; KINEMATICS.ACCEL_X = ax m/s2; WHEEL_SPEEDS.WHEEL_SPEED_FR = wfr km/h;
WHEEL_SPEEDS.WHEEL_SPEED_RL = wrl km/h
STEER_TORQUE_SENSOR.STEER_TORQUE_DRIVER = torque N*m
# openpilot by its fields
t = t s; vEgo = v m/s; aEgo = ax m/s2; yawRate = r rad/s; steeringAngleDeg = swa deg; vEgoCluster = v m/s;
vCruise = cruise km/h
# ROS odometry and IMU
header.stamp = t s; twist.twist.linear.x = vx m/s; twist.twist.linear.y = vy m/s; twist.twist.angular.z = r rad/s;
pose.pose.position.x = E m
pose.pose.position.y = N m; pose.pose.orientation.z = quat 1; imu.angular_velocity.z = r rad/s;
imu.linear_acceleration.x = ax m/s2
imu.linear_acceleration.y = ay m/s2; imu.linear_acceleration.z = az m/s2; imu.angular_velocity.x = p rad/s
# AiM
Time (s) = t s; GPS Speed (km/h) = v km/h; GPS LatAcc (g) = ay g; GPS LonAcc (g) = ax g;
GPS Heading (deg) = course deg; GPS Gyro (deg/s) = r deg/s
InlineAcc (g) = ax g; LateralAcc (g) = ay g; VerticalAcc (g) = az g; RPM (rpm) = engine rpm;
GPS PosAccuracy (mm) = noise 1
# MoTeC
Time = t s; Ground Speed = v km/h; G Force Lat = ay g; G Force Long = ax g; Steered Angle = swa deg;
Gyro Yaw Velocity = r deg/s; Engine RPM = engine rpm
Wheel Speed FL = wfl km/h; Wheel Speed RR = wrr km/h
# RaceChrono
elapsed_time = t s; speed (m/s) = v m/s; lateral_acc (G) = ay g; longitudinal_acc (G) = ax g; latitude (deg) = lat deg;
longitude (deg) = lon deg
bearing (deg) = course deg; rpm = engine rpm; x_rate_of_rotation (deg/s) = p deg/s;
z_rate_of_rotation (deg/s) = r deg/s
# TrackAddict
Time = t s; Speed (MPH) = v mph; Speed (Km/h) = v km/h; Latitude = lat deg; Longitude = lon deg; Heading = course deg;
Accel X = ay g; Accel Y = ax g
Accel Z = az g; Engine Speed (RPM) = engine rpm; Accuracy (m) = noise 1
# VBOX by columns
time = t s; latitude = lat deg; longitude = lon deg; velocity (km/h) = v km/h; heading = course deg;
Yaw_Rate = -r deg/s; Lat_Acc = ay g
Long_Acc = ax g; Gyro_Z = r deg/s; Steering_Angle = swa deg
# PX4 @ 25
timestamp = t us; vehicle_local_position.vx = vN m/s; vehicle_local_position.vy = -vE m/s;
vehicle_angular_velocity.xyz[2] = r rad/s
sensor_accel.x = ax m/s2; sensor_accel.y = ay m/s2; sensor_accel.z = az m/s2;
wheel_encoders.wheel_speed[0] = nrl rad/s
# CarSim
Time = t s; Vx = vx km/h; Vy = vy km/h; AVz = r deg/s; Ay = ay g; Ax = ax g; Steer_SW = swa deg; Beta = beta deg;
Yaw = psi deg; AV_Eng = engine rpm
AVy_L1 = nfl rpm; Vx_L1 = wfl km/h
# Simulink
time = t s; Vx_mps = vx m/s; Vy_mps = vy m/s; psi_dot_rad_s = r rad/s; delta_f_rad = delta rad; a_y_m_s2 = ay m/s2;
a_x_m_s2 = ax m/s2
omega_fl_rad_s = nfl rad/s
# Paper, symbols
t = t s; v_x = vx m/s; v_y = vy m/s; psi_dot = r rad/s; delta_f = delta rad; a_y = ay m/s2; a_x = ax m/s2;
beta = beta rad
# Paper, symbols in degrees
t = t s; v = v km/h; r = r deg/s; dpsi = r deg/s; delta = swa deg; ay = ay m/s2; beta = beta deg; psi = psi deg
# Navigation beside a bus
time = t s; INS_vx = vx m/s; INS_vy = vy m/s; INS_yawrate = r deg/s; INS_ay = ay m/s2; v_ego = v km/h;
n_mot = engine rpm; LWS_Angle = swa deg
# Trailer yard @ 10
t = t s; steer_ang = delta rad; vx = vx m/s; imu_accel_y = ay m/s2; imu_gyro_z = r rad/s; X = E m; Y = N m;
yaw = psi rad; yaw_rate = r rad/s
hitch = hitch rad; hitch_rate = hitchrate rad/s
# Farm tractor @ 1
t = t s; lat_deg = lat deg; lon_deg = lon deg; wheel_kmh = v km/h; heading_deg = course deg; PTO_speed = shaft rpm
# Messfahrt
Zeit [s] = t s; Fzg_Geschw [km/h] = v km/h; Gierrate [°/s] = r deg/s; Querbeschleunigung [m/s²] = ay m/s2;
Längsbeschleunigung [m/s²] = ax m/s2
Lenkradwinkel [°] = swa deg; Motordrehzahl [1/min] = engine rpm; Raddrehzahl_VL [1/min] = nfl rpm;
Lenkradmoment [Nm] = torque N*m
# Messfahrt, abgekürzt
t = t s; vFzg = v km/h; psiPunkt = r deg/s; aQuer = ay m/s2; aLaengs = ax m/s2; LRW = swa deg; nMot = engine rpm;
vRadVL = wfl km/h
# Race car of a museum
t = t s; vx = vx m/s; vy = vy m/s; yawRate = r rad/s; yawAngAcc = racc rad/s^2; axCG = ax m/s2; ayCG = ay m/s2;
delta = delta rad; deltaFL = delta rad
# Laps of a passenger car
t = t s; x = E m; y = N m; psi = psi rad; lat = lat deg; lon = lon deg; v = v m/s; vx = vx m/s; vy = vy m/s;
wz = r rad/s; a_lat = ay m/s2
a_long = ax m/s2; df = delta rad
# Everything in other units
time (ms) = t ms; Velocity [ft/s] = v ft/s; yaw rate [mrad/s] = r mrad/s; lat acc [ft/s^2] = ay ft/s2;
long accel (G) = ax g; road wheel angle [deg] = delta deg
# Knots and per second
UTC seconds = t s; SOG (kts) = v knot; COG (deg) = course deg; yaw rate [1/s] = r rad/s; ay [m s-2] = ay m/s2;
rudder = noise 1
# Wind, turbine, rotor, motor
time_s = t s; wind_speed = wind m/s; turbine_speed = turbine rpm; rotor_speed_rps = motor rpm; motor_speed = motor rpm;
fan_speed = fan rpm; speed = v m/s
yaw_rate = r rad/s
# What is wanted, and what is
time = t s; target_speed_kph = cruise km/h; speed_limit = cruise km/h; actual_speed_kph = v km/h;
steering_angle_request = noise deg; steering_angle = swa deg
yaw_rate_offset = noise deg/s; yaw_rate_raw = r deg/s; lat_accel_std = noise m/s2; lat_accel = ay m/s2
# Nothing but wheels and inputs
time = t s; rpm = engine rpm; throttle = percent 1; brake_pressure = torque N*m; wheel_speed_fl = wfl km/h;
wheel_speed_rl = wrl km/h
wheel_speed_rr = wrr km/h; gear = gear 1; lat_g = ay g; steering_torque = torque N*m
"""

HELD_OUT = r"""
# Ford Fusion by opendbc
time = t s; BrakeSysFeatures.Veh_V_ActlBrk = v km/h; Yaw_Data_FD1.VehYaw_W_Actl = r rad/s;
EngVehicleSpThrottle.EngAout_N_Actl = engine rpm
BrakeSnData_3.VehLatComp_A_Actl = ay m/s2; BrakeSnData_3.VehLong_A_Actl = ax m/s2;
SteeringPinion_Data.StePinComp_An_Est = swa deg
WheelSpeed.WhlFl_W_Meas = nfl rad/s; WheelSpeed.WhlFr_W_Meas = nfr rad/s
# Mazda by opendbc
time = t s; ENGINE_DATA.RPM = engine rpm; ENGINE_DATA.SPEED = v km/h; STEER.STEER_ANGLE = swa deg;
STEER_RATE.STEER_ANGLE_RATE = swr deg/s
WHEEL_SPEEDS.FL = wfl km/h; WHEEL_SPEEDS.FR = wfr km/h; WHEEL_SPEEDS.RL = wrl km/h; WHEEL_SPEEDS.RR = wrr km/h
# Hyundai by opendbc
timestamp = t s; SAS11.SAS_Angle = swa deg; SAS11.SAS_Speed = swr deg/s; ESP12.YAW_RATE = r deg/s;
ESP12.LAT_ACCEL = ay m/s2
ESP12.LONG_ACCEL = ax m/s2; CLU11.CF_Clu_Vanz = v km/h; EMS11.N = engine rpm; WHL_SPD11.WHL_SPD_FL = wfl km/h
# Volkswagen MQB
t = t s; ESP_21.ESP_v_Signal = v km/h; LWI_01.LWI_Lenkradwinkel = swa deg; LWI_01.LWI_Lenkradw_Geschw = swr deg/s
ESP_02.ESP_Gierrate = r deg/s; ESP_02.ESP_Querbeschleunigung = ay g; ESP_02.ESP_Laengsbeschl = ax m/s2
Motor_12.MO_Drehzahl_01 = engine rpm; ESP_19.ESP_HL_Radgeschw_02 = wrl km/h; ESP_19.ESP_HR_Radgeschw_02 = wrr km/h
# openpilot rlog
logMonoTime_s = t s; carState.vEgo = v m/s; carState.aEgo = ax m/s2; carState.yawRate = r rad/s;
carState.steeringAngleDeg = swa deg
carState.wheelSpeeds.fl = wfl m/s; carState.wheelSpeeds.rr = wrr m/s; carState.steeringRateDeg = swr deg/s;
carState.gas = throttle 1
# General Motors by opendbc
Time[s] = t s; ECMVehicleSpeed.VehicleSpeed = v mph; PSCMSteeringAngle.SteeringWheelAngle = swa deg;
ECMEngineStatus.EngineRPM = engine rpm
PSCMSteeringAngle.SteeringWheelRate = swr deg/s; EBCMVehicleDynamic.YawRate = r deg/s;
EBCMVehicleDynamic.LateralAcceleration = ay m/s2
EBCMWheelSpdRear.RLWheelSpd = wrl km/h; EBCMWheelSpdRear.RRWheelSpd = wrr km/h
# J1939 of a coach
Time (s) = t s; EEC1.EngSpeed (rpm) = engine rpm; ETC1.TransOutputShaftSpeed (rpm) = shaft rpm;
TCO1.TachographVehicleSpeed (km/h) = v km/h
EBC2.FrontAxleSpeed (km/h) = vx km/h; EBC2.RelativeSpeedFrontAxleLeftWheel (km/h) = slip km/h;
FD1.FanSpeed (rpm) = fan rpm
VDC2.SteerWheelAngle (rad) = swa rad; VDC2.YawRate (rad/s) = r rad/s; VDC2.LateralAcceleration (m/s^2) = ay m/s2
VDC2.LongitudinalAcceleration (m/s^2) = ax m/s2; TCO1.TachographOutputShaftSpeed (rpm) = shaft rpm
# OxTS NAVsuite
Time (GPS s) = t s; Lat (deg) = lat deg; Lon (deg) = lon deg; Speed2D (m/s) = v m/s; Vel forward (m/s) = vx m/s;
Vel lateral (m/s) = -vy m/s
Accel forward (m/s²) = ax m/s2; Accel lateral (m/s²) = -ay m/s2; Ang rate down (deg/s) = -r deg/s;
Heading (deg) = course deg
Pitch (deg) = pitch deg; Roll (deg) = roll deg
# VBOX 3i
sats = sats 1; time = t s; lat = lat deg; long = lon deg; velocity kmh = v km/h; heading = course deg; height = alt m
vertical velocity m/s = climb m/s; longitudinal acc g = ax g; lateral acc g = ay g; YAW_RATE deg/s = r deg/s
# Pi Toolbox
Time [s] = t s; vCar [kph] = v km/h; aSteerWheel [deg] = swa deg; gLat [g] = ay g; gLong [g] = ax g;
nEngine [rpm] = engine rpm
nYaw [deg/s] = r deg/s; vWheelFL [kph] = wfl km/h; vWheelFR [kph] = wfr km/h; pBrakeF [bar] = brake 1
# iRacing
SessionTime = t s; Speed = v m/s; YawRate = r rad/s; SteeringWheelAngle = swa rad; LatAccel = ay m/s2;
LongAccel = ax m/s2; VertAccel = az m/s2
VelocityX = vx m/s; VelocityY = vy m/s; RPM = engine rpm; LFspeed = wfl m/s; RFspeed = wfr m/s; Yaw = psi rad;
WindVel = wind m/s
# Torque of a telephone @ 5
Device Time (s) = t s; Longitude = lon deg; Latitude = lat deg; GPS Speed (Meters/second) = v m/s;
Speed (OBD)(km/h) = v km/h
Engine RPM(rpm) = engine rpm; G(x) = ay g; G(y) = ax g; G(z) = az g; Turbo Boost & Vacuum Gauge(psi) = brake 1;
Bearing = course deg
# Sensor logger of a telephone
seconds_elapsed = t s; location.speed = v m/s; location.bearing = course deg; gyroscope.z = r rad/s;
gyroscope.x = p rad/s
accelerometer.x = -ay m/s2; accelerometer.y = ax m/s2; gravity.z = az m/s2; location.speedAccuracy = noise m/s
# Autoware
stamp = t s; velocity_status.longitudinal_velocity = vx m/s; velocity_status.lateral_velocity = vy m/s;
velocity_status.heading_rate = r rad/s
steering_status.steering_tire_angle = delta rad; imu_raw.linear_acceleration.x = ax m/s2;
imu_raw.linear_acceleration.y = ay m/s2
imu_raw.angular_velocity.z = r rad/s; imu_raw.angular_velocity.x = p rad/s
# Apollo
timestamp_sec = t s; chassis.speed_mps = v m/s; chassis.steering_percentage = swpercent 1;
chassis.engine_rpm = engine rpm
pose.position.x = E m; pose.position.y = N m; pose.linear_velocity.x = vE m/s; pose.linear_velocity.y = vN m/s
pose.angular_velocity_vrf.z = r rad/s; pose.linear_acceleration_vrf.x = -ay m/s2;
pose.linear_acceleration_vrf.y = ax m/s2
# nuScenes vehicle monitor and pose
utime_s = t s; vehicle_monitor.vehicle_speed = v km/h; vehicle_monitor.steering = swa deg;
vehicle_monitor.yaw_rate = r deg/s
pose.rotation_rate[2] = r rad/s; pose.accel[0] = ax m/s2; pose.accel[1] = ay m/s2; pose.accel[2] = az m/s2;
zoe_veh_info.FL_wheel_speed = nfl rpm
# KITTI
t = t s; lat = lat deg; lon = lon deg; alt = alt m; roll = roll rad; pitch = pitch rad; yaw = psi rad; vn = vN m/s;
ve = vE m/s; vf = vx m/s
vl = vy m/s; vu = climb m/s; af = ax m/s2; al = ay m/s2; au = az m/s2; wf = p rad/s; wl = q rad/s; wu = r rad/s
# ArduPilot rover @ 25
TimeS = t s; GPS.Spd = v m/s; GPS.GCrs = course deg; IMU.GyrX = p rad/s; IMU.GyrY = q rad/s; IMU.GyrZ = -r rad/s;
IMU.AccX = ax m/s2
IMU.AccY = -ay m/s2; IMU.AccZ = -az m/s2; RCOU.C1 = pwm 1; ATT.Yaw = course deg
# CarMaker
Time = t s; Car.v = v m/s; Car.vx = vx m/s; Car.YawRate = r rad/s; Car.ay = ay m/s2; Car.ax = ax m/s2;
DM.Steer.Ang = swa rad
PT.Engine.rotv = engine rad/s; Car.SideSlipAngle = beta rad; Car.Yaw = psi rad; Car.WheelSpd_FL = nfl rad/s;
DM.Steer.AngVel = swr rad/s
# dSPACE ASM
Time[s] = t s; v_x_Vehicle_CoG[km|h] = vx km/h; YawRate_Vehicle[deg|s] = r deg/s; a_y_Vehicle_CoG[m|s2] = ay m/s2
a_x_Vehicle_CoG[m|s2] = ax m/s2; Angle_SteeringWheel[deg] = swa deg; omega_Wheel_FL[rad|s] = nfl rad/s;
n_Engine[rpm] = engine rpm
# Adams/Car
time = t s; chassis_velocities.longitudinal = vx km/h; chassis_velocities.yaw = r deg/s;
chassis_accelerations.lateral = ay g
chassis_accelerations.longitudinal = ax g; steering_wheel_input = swa deg; chassis_velocities.roll = p deg/s;
engine_speed = engine rpm
# Fahrversuch
Zeit / s = t s; Fahrgeschwindigkeit / km/h = v km/h; Giergeschwindigkeit / °/s = r deg/s; Schwimmwinkel / ° = beta deg;
LRW / ° = swa deg
Querbeschl / m/s² = ay m/s2; Laengsbeschl / m/s² = ax m/s2; Windgeschwindigkeit / m/s = wind m/s;
Motordrehzahl / 1/min = engine rpm
# Essai routier
temps (s) = t s; vitesse véhicule (km/h) = v km/h; vitesse de lacet (deg/s) = r deg/s; angle volant (deg) = swa deg
accélération transversale (m/s2) = ay m/s2; accélération longitudinale (m/s2) = ax m/s2;
régime moteur (tr/min) = engine rpm
# Test vehicle of a university
t_s = t s; vxCG (m/s) = vx m/s; vyCG (m/s) = vy m/s; yawRate (rad/s) = r rad/s; axCG (m/s^2) = ax m/s2;
ayCG (m/s^2) = ay m/s2
handwheelAngle (rad) = swa rad; engineSpeed (rad/s) = engine rad/s; wheelSpeedRL (rad/s) = nrl rad/s;
sideSlip (rad) = beta rad
# Paper with u and v
t [s] = t s; u [m/s] = vx m/s; v [m/s] = vy m/s; r [deg/s] = r deg/s; delta [deg] = delta deg; ay [m/s^2] = ay m/s2;
phi [deg] = roll deg
p [deg/s] = p deg/s
# RaceCapture
Interval|"s" = t s; AccelX|"G" = ay g; AccelY|"G" = ax g; AccelZ|"G" = az g; Yaw|"Deg/Sec" = r deg/s;
Speed|"MPH" = v mph; RPM|"" = engine rpm
Steering|"Deg" = swa deg; Latitude|"Degrees" = lat deg; Longitude|"Degrees" = lon deg
# LapTimer of a telephone @ 10
TIME_LAP = t s; LATITUDE = lat deg; LONGITUDE = lon deg; SPEED_KPH = v km/h; SPEED_MPH = v mph; HEIGHT_M = alt m;
LATERALG = ay g
LINEALG = ax g; RPM = engine rpm; LEANANGLE = roll deg; BEARING_DEG = course deg
# Tractor by ISOBUS @ 10
time_s = t s; WBSD.WheelBasedMachineSpeed = v m/s; GBSD.GroundBasedMachineSpeed = v m/s;
RPTO.RearPTOOutputShaftSpeed = shaft rpm
RHS.RearHitchPosition = throttle percent; EEC1.EngineSpeed = engine rpm; GMS.EstimatedCurvature = curvature 1/km;
AVG.YawRate = r deg/s
# Bus with an electric motor
Timestamp_s = t s; TractionMotorSpeed_rpm = motor rpm; CoolingFan1_Speed_pct = throttle percent;
WindSpeed_m_s = wind m/s; VehSpd_kph = v km/h
StrWhlAng_deg = swa deg; VehYawRate_degps = r deg/s; VehLatAccel_mps2 = ay m/s2; VehLongAccel_mps2 = ax m/s2;
TurboShaftSpeed = turbine rpm
# Tractor and semitrailer
time_s = t s; tractor_speed_mps = v m/s; tractor_yaw_rate_radps = r rad/s; trailer_yaw_rate_radps = rt rad/s;
hitch_angle_rad = hitch rad
tractor_steer_angle_rad = delta rad; trailer_lat_acc_mps2 = ayt m/s2; tractor_lat_acc_mps2 = ay m/s2
# Bosch sensors of a racing car
Time = t s; MM5_10_TX1.YAW_RATE = r deg/s; MM5_10_TX1.AY = ay g; MM5_10_TX2.AX = ax g; MM5_10_TX2.ROLL_RATE = p deg/s
LWS_STANDARD.LWS_ANGLE = swa deg; LWS_STANDARD.LWS_SPEED = swr deg/s; ABS.WSS_FL = wfl km/h; ABS.VEH_SPEED = v km/h
"""

FRESH = r"""
# Honda by opendbc
time = t s; CAR_SPEED.CAR_SPEED = v km/h; STEERING_SENSORS.STEER_ANGLE = swa deg;
STEERING_SENSORS.STEER_ANGLE_RATE = swr deg/s
VEHICLE_DYNAMICS.LAT_ACCEL = ay m/s2; VEHICLE_DYNAMICS.LONG_ACCEL = ax m/s2; POWERTRAIN_DATA.ENGINE_RPM = engine rpm;
WHEEL_SPEEDS.WHEEL_SPEED_RL = wrl km/h
# BMW by opendbc
t = t s; Speed.VehicleSpeed = v km/h; Speed.YawRate = r deg/s; Speed.AccY = ay m/s2; Speed.AccX = ax m/s2;
SteeringWheelAngle.SteeringPosition = swa deg
SteeringWheelAngle.SteeringSpeed = swr deg/s; EngineAndBrake.EngineTorque = torque N*m;
WheelSpeeds.Wheel_FL = wfl km/h
# Inertial unit of Racelogic
Time (s) = t s; Speed [km/h] = v km/h; Yaw rate [°/s] = r deg/s; X_Accel [g] = ax g; Y_Accel [g] = ay g;
Z_Accel [g] = az g; Pitch rate [°/s] = q deg/s
Roll rate [°/s] = p deg/s; Turbine speed [rpm] = turbine rpm
# SBG
timestamp [us] = t us; imu.gyroZ (deg/s) = r deg/s; imu.gyroX (deg/s) = p deg/s; imu.accelX (m/s2) = ax m/s2;
imu.accelY (m/s2) = ay m/s2
ekf.yaw (deg) = psi deg; ekf.velocityNorth (m/s) = vN m/s; ekf.velocityEast (m/s) = vE m/s;
odometer.velocity (m/s) = v m/s
# Marine-style receiver
UTC time [s] = t s; Latitude [deg] = lat deg; Longitude [deg] = lon deg; Horizontal speed [m/s] = v m/s;
Track over ground [deg] = course deg
Vertical speed [m/s] = climb m/s; Wind speed [kts] = wind knot
# Ego and others
t_ms = t ms; ego_velocity_mps = v m/s; ego_yawrate_rps = r rad/s; ego_accel_lon_mps2 = ax m/s2;
ego_accel_lat_mps2 = ay m/s2; target_velocity_mps = cruise m/s
lead_vehicle_speed_mps = cruise m/s; steering_wheel_angle_rad = swa rad
# Tracks from above @ 25
time = t s; xVelocity = vE m/s; yVelocity = vN m/s; lonVelocity = vx m/s; latVelocity = vy m/s;
lonAcceleration = ax m/s2; latAcceleration = ay m/s2
heading = course deg; xCenter = E m; yCenter = N m
# Audi bus
timestamp = t us; vehicle_speed = v km/h; steering_angle_calculated = swa deg; acceleration_x = ax m/s2;
acceleration_y = ay m/s2; acceleration_z = az m/s2
angular_velocity_omega_z = r deg/s; angular_velocity_omega_x = p deg/s; accelerator_pedal = percent 1
# Drive by wire in ROS
stamp = t s; vehicle/steering_report.speed = v m/s; vehicle/steering_report.steering_wheel_angle = swa rad;
vehicle/imu/data_raw.angular_velocity.z = r rad/s
vehicle/imu/data_raw.linear_acceleration.x = ax m/s2; vehicle/imu/data_raw.linear_acceleration.y = ay m/s2;
vehicle/wheel_speed_report.front_left = nfl rad/s
# Fleet management of a truck @ 10
Time = t s; FMS_EEC1_EngineSpeed [rpm] = engine rpm; FMS_CCVS_WheelBasedSpeed [km/h] = v km/h;
EBS22.TrailerYawRate = rt rad/s; VDC2.YawRate = r rad/s
VDC2.LatAccel = ay m/s2; VDC2.SteerWhlAngle = swa rad; TCO1.OutputShaftSpeed = shaft rpm
# Racing game
m_sessionTime = t s; m_speed = v m/s; m_gForceLateral = ay g; m_gForceLongitudinal = ax g; m_engineRPM = engine rpm;
m_steer = swpercent 1
m_wheelSpeed[0] = wrl m/s
# Paper in TeX
t (s) = t s; V_x (km/h) = vx km/h; \dot{\psi} (deg/s) = r deg/s; a_y (m/s^2) = ay m/s2; \delta_{SW} (deg) = swa deg;
\beta (deg) = beta deg
\omega_{rl} (rad/s) = nrl rad/s
# Self-made logger
millis = t ms; gx (dps) = p deg/s; gy (dps) = q deg/s; gz (dps) = r deg/s; ax (g) = ax g; ay (g) = ay g; az (g) = az g;
gps_speed_kmh = v km/h
motor_rpm = motor rpm
# Test bench
TIME [s] = t s; N_ENGINE [rpm] = engine rpm; V_VEHICLE [km/h] = v km/h; A_LONG [m/s²] = ax m/s2;
ALPHA_PEDAL [%] = percent 1; N_FAN [rpm] = fan rpm
T_OIL [°C] = temp 1
# Lenkversuch
Zeit [s] = t s; Lenkradwinkel [°] = swa deg; Lenkradgeschwindigkeit [°/s] = swr deg/s; v_GPS [km/h] = v km/h;
ay_S [m/s²] = ay m/s2; psip [°/s] = r deg/s
Gierbeschleunigung [°/s²] = racc rad/s^2; M_H [Nm] = torque N*m
"""
