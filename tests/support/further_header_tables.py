"""Headers by somebody who had not seen the code that reads them, in the form of ``support.header_tables``.

When first read, 77 % of the answers were right, 20 % left out, 3 % wrong, and the header in a script without Latin
letters ended in a traceback.
"""

FURTHER = r"""
# Subaru before Global by opendbc
time = t s; G_Sensor.Steering_Angle = swa deg; G_Sensor.Lateral = ay m/s2; G_Sensor.Longitudinal = ax m/s2;
Brake_Pedal.Speed = v km/h; Brake_Pedal.Brake_Pedal = brake 1; Throttle.Engine_RPM = engine rpm;
Throttle.Throttle_Pedal = percent 1; Wheel_Speeds.FL = wfl km/h; Wheel_Speeds.RR = wrr km/h;
Steering_Torque.Steer_Torque_Sensor = torque N*m; ES_CruiseThrottle.Cruise_Set_Speed = cruise km/h
# Nissan Leaf by opendbc
time = t s; STEER_ANGLE_SENSOR.STEER_ANGLE = swa deg; STEER_ANGLE_SENSOR.STEER_ANGLE_RATE = swr deg/s;
WHEEL_SPEEDS_FRONT.WHEEL_SPEED_FL = wfl km/h; WHEEL_SPEEDS_FRONT.WHEEL_SPEED_FR = wfr km/h;
WHEEL_SPEEDS_REAR.WHEEL_SPEED_RL = wrl km/h; WHEEL_SPEEDS_REAR.WHEEL_SPEED_RR = wrr km/h;
PROPILOT_HUD.SET_SPEED = cruise km/h; LKAS.DESIRED_ANGLE = noise deg;
STEER_TORQUE_SENSOR.STEER_TORQUE_DRIVER = torque N*m; CRUISE_THROTTLE.GAS_PEDAL = percent 1; LKAS.COUNTER = noise 1
# Tesla Model 3 by message numbers
Time = t s; ID257DIspeed.DI_vehicleSpeed = v km/h; ID257DIspeed.DI_uiSpeed = v mph;
ID129SteeringAngle.SteeringAngle129 = swa deg; ID129SteeringAngle.SteeringSpeed129 = swr deg/s;
ID101RCM_inertial1.RCM_yawRate = r rad/s; ID101RCM_inertial1.RCM_pitchRate = q rad/s;
ID111RCM_inertial2.RCM_lateralAccel = ay m/s2; ID111RCM_inertial2.RCM_longitudinalAccel = ax m/s2;
ID111RCM_inertial2.RCM_verticalAccel = az m/s2; ID108DIR_torque.DIR_axleSpeed = shaft rpm;
ID175WheelSpeed.WheelSpeedFL175 = nfl rpm; ID175WheelSpeed.WheelSpeedRR175 = nrr rpm;
ID2B9DAS_control.DAS_setSpeed = cruise km/h; ID2B9DAS_control.DAS_accelMax = noise m/s2
# Volvo SPA
Time_s = t s; VehSpdLgtSafe.VehSpdLgtA = v m/s; AgDataRawSafe.YawRate = r rad/s; AgDataRawSafe.RollRate = p rad/s;
ADataRawSafe.ALat = ay m/s2; ADataRawSafe.ALgt = ax m/s2; ADataRawSafe.AVert = az m/s2;
SteerWhlSnsrSafe.SteerWhlAgSafe = swa rad; SteerWhlSnsrSafe.SteerWhlAgSpdSafe = swr rad/s;
WhlRotToothCntr.WhlRotToothCntrFrntLe = noise 1; WhlMotSysFrnt.EngN = engine rpm; AgDataRawSafe.YawRateQf = gear 1;
AgDataRawSafe.CntrAgDataRawSafe = noise 1
# Peugeot by opendbc
temps = t s; HS2_DYN_ABR_38D.VITESSE_VEHICULE_ROUES = v km/h; HS2_DYN_UCF_MDD_32D.VITESSE_LACET_BRUTE = r deg/s;
HS2_DYN_UCF_MDD_32D.ACCEL_LATERALE_BRUTE = ay m/s2; HS2_DYN_UCF_MDD_32D.ACCEL_LONGI = ax m/s2;
STEERING_ALT.ANGLE = swa deg; STEERING_ALT.RATE = swr deg/s; HS2_DYN1_MDD_ETAT_2B6.CONSIGNE_VITESSE = cruise km/h;
DYN_CMM.REGIME_MOTEUR = engine rpm; DYN4_FRE.P263_VehV_VPsvValWhlFrtL = wfl km/h;
DYN4_FRE.P266_VehV_VPsvValWhlBckR = wrr km/h; STEERING.DRIVER_TORQUE = torque N*m
# Volkswagen PQ
Zeit = t s; Bremse_1.BR1_Rad_kmh = v km/h; Lenkwinkel_1.LW1_LRW = swa deg; Lenkwinkel_1.LW1_Lenk_Gesch = swr deg/s;
Bremse_5.BR5_Giergeschw = r deg/s; Bremse_5.BR5_Bremsdruck = brake 1; Bremse_8.BR8_Querbeschl = ay g;
Bremse_8.BR8_Laengsbeschl = ax m/s2; Bremse_3.BR3_Rad_kmh_VL = wfl km/h; Bremse_3.BR3_Rad_kmh_HR = wrr km/h;
Motor_1.MO1_Drehzahl = engine rpm; Motor_2.MO2_Sollgeschw = cruise km/h; Lenkhilfe_3.LH3_LM = torque N*m
# Mercedes chassis bus
t = t s; LRW = swa deg; VLRW = swr deg/s; GIER_ROH = r deg/s; AY_S = ay g; AX_S = ax g; V_ANZ = v km/h; DVL = nfl rpm;
DVR = nfr rpm; DHL = nrl rpm; DHR = nrr rpm; NMOT = engine rpm; V_TMX = cruise km/h; BZ_LW = noise 1
# J1939 by numbers
timestamp [s] = t s; SPN84 [km/h] = v km/h; SPN190 [rpm] = engine rpm; SPN191 [rpm] = shaft rpm;
SPN904 [km/h] = vx km/h; SPN1807 Steering Wheel Angle [rad] = swa rad; SPN1808 Yaw Rate [rad/s] = r rad/s;
SPN1809 Lateral Acceleration [m/s²] = ay m/s2; SPN1810 Longitudinal Acceleration [m/s²] = ax m/s2;
SPN86 [km/h] = cruise km/h; SPN977 [rpm] = fan rpm; SPN103 [rpm] = turbine rpm
# CANoe, Fahrzeugbus
Time[s] = t s; CAN1::ESP_Data::VehicleDynamics_01::VehDyn_YawRate[deg/s] = r deg/s;
CAN1::ESP_Data::VehicleDynamics_01::VehDyn_YawRateSetpoint[deg/s] = noise deg/s;
CAN1::ESP_Data::VehicleDynamics_01::VehDyn_AccLat[m/s^2] = ay m/s2;
CAN1::ESP_Data::VehicleDynamics_01::VehDyn_AccLong[m/s^2] = ax m/s2;
CAN1::EPS::Steering_01::StrngWhlAgl[deg] = swa deg; CAN1::EPS::Steering_01::StrngWhlTrq[Nm] = torque N*m;
CAN1::ESP_Data::Speed_01::VehSpd[km/h] = v km/h; CAN1::ESP_Data::Speed_01::VehSpd_Cntr = noise 1;
CAN1::ECM::Engine_01::EngSpd[1/min] = engine rpm; CAN1::DI::Display_01::DispSpd[km/h] = v km/h
# ADTF of a model car @ 50
tTimeStamp = t us; MeasuredSpeed.f32Value = v m/s; DesiredSpeed.f32Value = cruise m/s;
SteeringController.f32Value = pwm 1; InerMeasUnitStruct.f32A_x = ax m/s2; InerMeasUnitStruct.f32A_y = ay m/s2;
InerMeasUnitStruct.f32A_z = az m/s2; InerMeasUnitStruct.f32G_x = p deg/s; InerMeasUnitStruct.f32G_y = q deg/s;
InerMeasUnitStruct.f32G_z = r deg/s; WheelStructLeft.ui32WheelTach = noise 1; WheelStructRight.i8WheelDir = gear 1;
SupplyVoltage.ui32Value = noise 1
# FORScan @ 5
time(ms) = t ms; VSS(km/h) = v km/h; RPM(1/min) = engine rpm; STEER_ANGL(°) = swa deg; YAW_RATE(°/s) = r deg/s;
LAT_ACCL(m/s²) = ay m/s2; LONGACCL(m/s²) = ax m/s2; LF_WSPD(km/h) = wfl km/h; RR_WSPD(km/h) = wrr km/h;
TSS(1/min) = turbine rpm; OSS(1/min) = shaft rpm; FANVAR(%) = percent 1; ECT(°C) = temp 1
# OpenXC @ 10
timestamp = t s; vehicle_speed = v km/h; steering_wheel_angle = swa deg; engine_speed = engine rpm;
torque_at_transmission = torque N*m; accelerator_pedal_position = percent 1; transmission_gear_position = gear 1;
latitude = lat deg; longitude = lon deg; odometer = noise 1
# Drives in San Francisco @ 10
unix_ts = t s; lat = lat deg; lng = lon deg; steer_angle = swa deg; steer_speed = swr deg/s; speed = v km/h;
yaw = r deg/s; accel_pedal = percent 1; brake_pressure = brake 1; engine_rpm = engine rpm; left_turn = gear 1
# Steering control of routes @ 10
t = t s; vEgo = v m/s; aEgo = ax m/s2; steeringAngleDeg = swa deg; steer = percent 1; steerFiltered = percent 1;
latAccelSteeringAngle = ay m/s2; latAccelDesired = noise m/s2; latAccelLocalizer = ay m/s2; roll = roll rad;
latActive = gear 1
# Udacity
timestamp = t s; steering.angle = swa rad; steering.torque = torque N*m; steering.speed = v m/s; gps.lat = lat deg;
gps.long = lon deg; gps.alt = alt m; imu.ang_vel_x = p rad/s; imu.ang_vel_y = q rad/s; imu.ang_vel_z = r rad/s;
imu.lin_acc_x = ax m/s2; imu.lin_acc_y = ay m/s2; throttle.pedal_cmd = percent 1; brake.pedal_cmd = brake 1
# nuPlan
timestamp = t us; ego_pose.x = E m; ego_pose.y = N m; ego_pose.qz = quat 1; ego_pose.vx = vx m/s; ego_pose.vy = vy m/s;
ego_pose.vz = climb m/s; ego_pose.acceleration_x = ax m/s2; ego_pose.acceleration_y = ay m/s2;
ego_pose.acceleration_z = az m/s2; ego_pose.angular_rate_x = p rad/s; ego_pose.angular_rate_y = q rad/s;
ego_pose.angular_rate_z = r rad/s
# Frames of a robotaxi @ 10
timestamp_micros = t us; velocity.v_x = vE m/s; velocity.v_y = vN m/s; velocity.v_z = climb m/s;
velocity.w_x = p rad/s; velocity.w_y = q rad/s; velocity.w_z = r rad/s; pose.tx = E m; pose.ty = N m;
pose.yaw = psi rad
# Kinematic state of Autoware.Auto
stamp.sec = t s; state.x = E m; state.y = N m; state.heading.imag = quat 1; state.longitudinal_velocity_mps = vx m/s;
state.lateral_velocity_mps = vy m/s; state.acceleration_mps2 = ax m/s2; state.heading_rate_rps = r rad/s;
state.front_wheel_angle_rad = delta rad; state.rear_wheel_angle_rad = noise rad;
control_command.velocity_mps = cruise m/s; control_command.long_accel_mps2 = noise m/s2;
control_command.front_wheel_angle_rad = noise rad
# F1TENTH @ 40
%time = t s; /odom.twist.twist.linear.x = vx m/s; /odom.twist.twist.angular.z = r rad/s;
/odom.pose.pose.orientation.z = quat 1; /drive.drive.speed = cruise m/s; /drive.drive.steering_angle = noise rad;
/sensors/core.state.speed = motor rpm; /sensors/core.state.current_motor = torque N*m;
/sensors/servo_position_command.data = pwm 1; /sensors/imu/raw.linear_acceleration.x = ax m/s2;
/sensors/imu/raw.linear_acceleration.y = ay m/s2; /sensors/imu/raw.angular_velocity.z = r rad/s
# PX4 rover with setpoints @ 25
timestamp = t us; rover_speed_status.measured_speed_body_x = vx m/s;
rover_speed_status.adjusted_speed_body_x_setpoint = cruise m/s; rover_rate_status.measured_yaw_rate = -r rad/s;
rover_rate_status.adjusted_yaw_rate_setpoint = noise rad/s; rover_attitude_status.measured_yaw = course rad;
vehicle_acceleration.xyz[0] = ax m/s2; vehicle_acceleration.xyz[1] = -ay m/s2; vehicle_acceleration.xyz[2] = -az m/s2;
vehicle_gps_position.vel_m_s = v m/s; vehicle_gps_position.cog_rad = course rad;
vehicle_gps_position.s_variance_m_s = noise m/s; wind.windspeed_north = wind m/s
# ArduPilot by its controllers @ 10
TimeS = t s; STER.TurnRate = -r deg/s; STER.DesTurnRate = noise deg/s; STER.LatAcc = -ay m/s2;
STER.DesLatAcc = noise m/s2; STER.SteerOut = pwm 1; THR.Speed = vx m/s; THR.DesSpeed = cruise m/s; THR.AccX = ax m/s2;
THR.ThrOut = percent 1; NTUN.WpBrg = course deg; RPM.rpm1 = motor rpm; VIBE.VibeX = noise m/s2
# OxTS by NCOM
Time (s) = t s; PosLat (deg) = lat deg; PosLon (deg) = lon deg; VelNorth (m/s) = vN m/s; VelEast (m/s) = vE m/s;
VelForward (m/s) = vx m/s; VelLateral (m/s) = -vy m/s; Speed2d (m/s) = v m/s; AngleHeading (deg) = course deg;
AngleTrack (deg) = course deg; AngleSlip (deg) = -beta deg; AngRateX (deg/s) = p deg/s; AngRateY (deg/s) = -q deg/s;
AngRateZ (deg/s) = -r deg/s; AccelForward (m/s2) = ax m/s2; AccelLateral (m/s2) = -ay m/s2;
AccelDown (m/s2) = -az m/s2; AngAccelZ (deg/s2) = noise 1
# NovAtel SPAN
Seconds into Week (s) = t s; INSPVAX Latitude (deg) = lat deg; INSPVAX Longitude (deg) = lon deg;
INSPVAX North Vel (m/s) = vN m/s; INSPVAX East Vel (m/s) = vE m/s; INSPVAX Up Vel (m/s) = climb m/s;
INSPVAX Azimuth (deg) = course deg; INSPVAX North Vel Std Dev (m/s) = noise m/s; CORRIMU PitchRate (rad/s) = -q rad/s;
CORRIMU RollRate (rad/s) = p rad/s; CORRIMU YawRate (rad/s) = r rad/s; CORRIMU LateralAcc (m/s2) = -ay m/s2;
CORRIMU LongitudinalAcc (m/s2) = ax m/s2; CORRIMU VerticalAcc (m/s2) = noise m/s2; BESTVEL Hor Spd (m/s) = v m/s
# Septentrio @ 10
TOW [s] = t s; PVTGeodetic.Latitude [rad] = lat rad; PVTGeodetic.Longitude [rad] = lon rad;
PVTGeodetic.Vn [m/s] = vN m/s; PVTGeodetic.Ve [m/s] = vE m/s; PVTGeodetic.Vu [m/s] = climb m/s;
PVTGeodetic.COG [deg] = course deg; AttEuler.Heading [deg] = course deg; AttEuler.HeadingDot [deg/s] = -r deg/s;
ExtSensorMeas.AccelerationX [m/s2] = ax m/s2; ExtSensorMeas.AccelerationY [m/s2] = -ay m/s2;
ExtSensorMeas.AngularRateZ [deg/s] = -r deg/s; PVTGeodetic.NrSV = sats 1
# ADMA
Time [s] = t s; Acc_Body_X [g] = ax g; Acc_Body_Y [g] = ay g; Acc_Body_Z [g] = az g; Rate_Body_X [°/s] = p deg/s;
Rate_Body_Y [°/s] = q deg/s; Rate_Body_Z [°/s] = r deg/s; INS_Vel_Hor_X [m/s] = vx m/s; INS_Vel_Hor_Y [m/s] = vy m/s;
INS_Vel_Frame_X [m/s] = vE m/s; INS_Yaw [°] = psi deg; INS_Stddev_Vel_X [m/s] = noise m/s;
Ext_Vel_An_X [m/s] = noise m/s; GPS_COG [°] = course deg
# Optischer Sensor und Messlenkrad
Zeit [s] = t s; SMotion_Vl [km/h] = vx km/h; SMotion_Vq [km/h] = vy km/h; SMotion_V [km/h] = v km/h;
SMotion_Winkel [°] = beta deg; MSW_Winkel [°] = swa deg; MSW_Winkelgeschw [°/s] = swr deg/s;
MSW_Moment [Nm] = torque N*m; TANS_Gierrate [°/s] = r deg/s; TANS_Wankrate [°/s] = p deg/s; TANS_aQuer [g] = ay g;
TANS_aLaengs [g] = ax g; RadDZ_VL [1/min] = nfl rpm
# TruckSim with a trailer
Time = t s; Vx_SM = vx km/h; Vx_Trgt = cruise km/h; AVz_1 = r deg/s; AVz_2 = rt deg/s; AyCG_1 = ay g; AyCG_2 = ayt g;
AxCG_1 = ax g; Steer_SW = swa deg; StrAV_SW = swr deg/s; Steer_L1 = delta deg; Art_H1 = hitch deg; AV_Eng = engine rpm;
AVy_L2i = nrl rpm
# Dymola
time = t s; vehicle.chassis.body.v_x = vx m/s; vehicle.chassis.body.v_y = vy m/s;
vehicle.chassis.body.w_a[1] = p rad/s; vehicle.chassis.body.w_a[3] = r rad/s; vehicle.chassis.body.a_lat = ay m/s2;
vehicle.chassis.body.a_long = ax m/s2; vehicle.steering.steeringWheel.phi = swa rad;
vehicle.steering.steeringWheel.w = swr rad/s; vehicle.chassis.wheel_1.hub.w = nfl rad/s;
vehicle.engine.flange_b.w = engine rad/s; driver.v_ref = cruise m/s; vehicle.chassis.body.beta = beta rad
# ControlDesk
XAxis = t s; Model Root/VehicleModel/Outputs/v_Veh[km/h] = v km/h;
Model Root/VehicleModel/Outputs/psi_p[rad/s] = r rad/s; Model Root/VehicleModel/Outputs/a_y_Sensor[m/s^2] = ay m/s2;
Model Root/VehicleModel/Outputs/a_x_Sensor[m/s^2] = ax m/s2; Model Root/Steering/delta_H[rad] = swa rad;
Model Root/Steering/delta_H_p[rad/s] = swr rad/s; Model Root/Controller/psi_p_Ref[rad/s] = noise rad/s;
Model Root/Controller/v_Ref[km/h] = cruise km/h; Model Root/Drivetrain/n_Eng[rpm] = engine rpm;
Model Root/Drivetrain/omega_Wheel[FL][rad/s] = nfl rad/s
# Vehicle Dynamics Blockset
Time = t s; Body.BdyFrm.Cg.Vel.xdot = vx m/s; Body.BdyFrm.Cg.Vel.ydot = -vy m/s; Body.BdyFrm.Cg.AngVel.p = p rad/s;
Body.BdyFrm.Cg.AngVel.q = -q rad/s; Body.BdyFrm.Cg.AngVel.r = -r rad/s; Body.BdyFrm.Cg.Acc.ax = ax m/s2;
Body.BdyFrm.Cg.Acc.ay = -ay m/s2; Body.BdyFrm.Cg.Ang.Beta = -beta rad; Driver.SteerFdbk = -swa rad;
Driver.VelRef = cruise m/s; Wheels.WhlAng.FrntLft = -delta rad; Engine.EngSpdRpm = engine rpm
# ATLAS
TimeStamp = t s; vCar:Chassis (kph) = v km/h; vCarTarget:Strategy (kph) = cruise km/h; gLat:Chassis (g) = ay g;
gLong:Chassis (g) = ax g; gVert:Chassis (g) = az g; nYawRate:Chassis (deg/s) = r deg/s;
aSteeringWheel:Chassis (deg) = swa deg; nEngine:FIA (rpm) = engine rpm; nMGUK:PU (rpm) = motor rpm;
nTurbo:PU (rpm) = turbine rpm; nWheelRL:Chassis (rpm) = nrl rpm; rThrottlePedal:Driver (%) = percent 1;
NGear:Gearbox = gear 1
# WinDarab
xtime [s] = t s; speed [km/h] = v km/h; speed_limit [km/h] = cruise km/h; speedfl [km/h] = wfl km/h;
speedrr [km/h] = wrr km/h; nmot [1/min] = engine rpm; accx [g] = ax g; accy [g] = ay g; accz [g] = az g;
yawrate_abs [°/s] = r deg/s; steer [°] = swa deg; u_steer [V] = noise 1; ath [%] = percent 1; pbrake_f [bar] = brake 1;
gear = gear 1
# Formula Student, electric
time_ms = t ms; INS_vx_mps = vx m/s; INS_vy_mps = vy m/s; INS_yaw_rate_radps = r rad/s; INS_ax_mps2 = ax m/s2;
INS_ay_mps2 = ay m/s2; VCU_TV_yaw_rate_ref_radps = noise rad/s; VCU_v_est_mps = v m/s;
SAS_steering_wheel_deg = swa deg; SAS_raw_adc = pwm 1; AMK_FL_ActualVelocity_rpm = nfl rpm;
AMK_RR_ActualVelocity_rpm = nrr rpm; AMK_FL_TargetVelocity_rpm = motor rpm; APPS1_pct = percent 1;
Fan_Duty_pct = percent 1
# phyphox of a telephone lying flat @ 50
Time (s) = t s; Linear Acceleration x (m/s^2) = -ay m/s2; Linear Acceleration y (m/s^2) = ax m/s2;
Linear Acceleration z (m/s^2) = noise m/s2; Gyroscope x (rad/s) = -q rad/s; Gyroscope y (rad/s) = p rad/s;
Gyroscope z (rad/s) = r rad/s; Latitude (°) = lat deg; Longitude (°) = lon deg; Velocity (m/s) = v m/s;
Direction (°) = course deg; Horizontal Accuracy (m) = noise m
# Harvester by NMEA 2000 @ 10
Time (s) = t s; 129026 SOG (m/s) = v m/s; 129026 COG (rad) = course rad; 127251 Rate of Turn (rad/s) = -r rad/s;
127250 Heading (rad) = course rad; 127245 Rudder Position (rad) = -delta rad; 127488 Engine Speed (rpm) = engine rpm;
130306 Wind Speed (m/s) = wind m/s; 129025 Latitude (deg) = lat deg; 129025 Longitude (deg) = lon deg;
65096 Wheel-based Machine Speed (m/s) = v m/s; Threshing Rotor Speed (rpm) = turbine rpm;
Cleaning Fan Speed (rpm) = fan rpm
# AgOpenGPS @ 10
Time = t s; Latitude = lat deg; Longitude = lon deg; AvgSpeed_kmh = v km/h; FixHeading_rad = course rad;
IMU_Roll_deg = roll deg; IMU_YawRate_degs = -r deg/s; WAS_ActualSteerAngle_deg = -delta deg;
SetSteerAngle_deg = noise deg; WAS_Counts = pwm 1; SteerPWM = pwm 1; CrossTrackError_mm = noise 1; HydLift = gear 1
# Lastbilsprov
tid [s] = t s; hastighet [km/h] = v km/h; farthållare börvärde [km/h] = cruise km/h; girhastighet [grader/s] = r deg/s;
rattvinkel [grader] = swa deg; rattmoment [Nm] = torque N*m; sidoacceleration [m/s2] = ay m/s2;
längsacceleration [m/s2] = ax m/s2; motorvarvtal [varv/min] = engine rpm; kardanvarvtal [varv/min] = shaft rpm;
fläktvarvtal [varv/min] = fan rpm; hjulhastighet VF [km/h] = wfl km/h; släp girhastighet [grader/s] = rt deg/s
# Jidousha shiken, romaji
jikan (s) = t s; shasoku (km/h) = v km/h; mokuhyou shasoku (km/h) = cruise km/h; yoo reeto (deg/s) = r deg/s;
souda kaku (deg) = swa deg; souda torque (Nm) = torque N*m; yoko G (G) = ay g; zengo G (G) = ax g; jouge G (G) = az g;
engine kaitensuu (rpm) = engine rpm; sharinsoku FL (km/h) = wfl km/h
# Jidousha shiken
時間[s] = t s; 車速[km/h] = v km/h; ヨーレイト[deg/s] = r deg/s; ロールレイト[deg/s] = p deg/s; 操舵角[deg] = swa deg;
操舵トルク[Nm] = torque N*m; 横加速度[m/s2] = ay m/s2;
前後加速度[m/s2] = ax m/s2;
エンジン回転数[rpm] = engine rpm; 車輪速FL[km/h] = wfl km/h;
横すべり角[deg] = beta deg
# Shiche shuju
时间(s) = t s; 车速(km/h) = v km/h; 目标车速(km/h) = cruise km/h; 横摆角速度(deg/s) = r deg/s;
方向盘转角(deg) = swa deg;
方向盘转速(deg/s) = swr deg/s;
侧向加速度(m/s^2) = ay m/s2; 纵向加速度(m/s^2) = ax m/s2; 电机转速(rpm) = motor rpm; 左前轮速(km/h) = wfl km/h;
质心侧偏角(deg) = beta deg
"""
