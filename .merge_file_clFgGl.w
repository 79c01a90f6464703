#
 
Architecture
<NL>
<NL>
Read
 
this
 
in
 
five
 
minutes;
 
then
 
a
 
file's
 
name
 
should
 
tell
 
you
 
where
 
to
 
change
 
what.
<NL>
<NL>
##
 
The
 
way
 
of
 
the
 
data
<NL>
<NL>
```
<NL>
cameras
 
--images-->
 
estimate
 
--ball-->
 
track
 
--ball-->
 
predict
 
--path-->
 
racket
 
--strokes-->
 
arm
 
--velocities-->
 
plant
<NL>
 
(sim,
 
driver
        
position,
          
wide
 
cameras
    
flight,
           
where
 
to
          
joints,
             
(sim
 
or
<NL>
  
or
 
replay)
         
velocity,
 
spin
     
(on
 
request)
    
bounce
            
hit,
 
how
          
swing,
 
servo
         
PA10)
<NL>
```
<NL>
<NL>
One
 
process
 
per
 
node,
 
one
 
way:
 
no
 
node
 
asks
 
an
 
earlier
 
one
 
a
 
question.
 
Nodes
 
are
 
single-threaded,
 
but
 
in
 
the
 
arm's,
 
guard
 
and
 
servo
 
have
 
a
<NL>
thread
 
of
 
their
 
own
 
beside
 
planning.
 
Whoever
 
needs
 
two
 
parts
 
in
 
one
 
process
 
(a
 
benchmark,
 
a
 
Monte
 
Carlo
 
run,
 
a
 
robot
 
that
 
counts
<NL>
microseconds)
 
calls
 
the
 
same
 
functions
 
without
 
ROS;
 
nothing
 
but
 
the
 
files
 
named
 
below
 
knows
 
ROS.
<NL>
<NL>
##
 
The
 
tree
<NL>
<NL>
|
 
folder
 
|
 
reads
 
in
 
this
 
order
 
|
 
what
 
it
 
holds
 
|
<NL>
|---|---|---|
<NL>
|
 
`tt_core`
 
|
 
`constants`
 
`errors`
 
`failures`
 
`params`
 
`arrays`
 
`interpolate`
 
`path_end`
 
`states`
 
`flight`
 
`table_contacts`
 
`bounce`
 
`physics`
 
`factors`
 
`learnt_physics`
 
`events`
 
`tangents`
 
`hit_windows`
 
`so3`
 
`images`
 
`lens`
 
`text_enum`
 
`yaml_errors`
 
`yaml_converter`
 
`strict_yaml`
 
`robots`
 
`clock_offsets`
 
`priority`
 
`revision`
 
`start`
 
|
 
the
 
shared
 
vocabulary,
 
the
 
physical
 
models
 
as
 
compiled
 
kernels
 
behind
 
dataclasses,
 
and
 
flight
 
from
 
event
 
to
 
event;
 
no
 
node
 
|
<NL>
|
 
`tt_core/ros`
 
|
 
`convert`
 
`params`
 
`qos`
 
`inputs`
 
`diagnostics`
 
`terminal`
 
`refusals`
 
`clock_offset`
 
`discovery`
 
`bags`
 
`node_main`
 
|
 
the
 
only
 
code
 
that
 
knows
 
messages,
 
parameters,
 
quality
 
of
 
service,
 
diagnostics
 
and
 
executors
 
|
<NL>
|
 
`tt_vision`
 
|
 
`projection`
 
`camera`
 
`triangulation`
 
`resection`
 
`rig`
 
`capture/`
 
(`burst`
 
`devices`
 
`sources`
 
`assembler`)
 
`detection/`
 
(`outline`
 
`ball_detection`
 
`lens_correction`
 
`illumination`)
 
`motion_fit`
 
`spin/`
 
(`surface_map`
 
`soft_surface`
 
`mark_sampling`
 
`sphere_grid`
 
`coarse_search`
 
`wide_search`
 
`comparison`
 
`registration`
 
`ball_marks`
 
`relighting`
 
`limb_refinement`
 
`estimate`
 
`distance_refinement`
 
`dissertation`)
 
`first_look`
 
`measure`
 
`tracking/`
 
(`params`
 
`history`
 
`cold_start`
 
`window_fit`
 
`prediction`
 
`tracker`)
 
`warm`
 
`calibrate`
 
`camera_pose`
 
`estimate_node`
 
`track_node`
 
`camera_node`
 
|
 
six
 
frames
 
of
 
two
 
cameras
 
to
 
position,
 
velocity
 
and
 
spin
 
with
 
covariance;
 
`measure`
 
alone
 
calls
 
the
 
stages,
 
each
 
a
 
function
 
from
 
one
 
object
 
to
 
the
 
next
 
|
<NL>
|
 
`tt_predict`
 
|
 
`rollout`
 
`uncertainty`
 
`net_touch`
 
`recordings`
 
`landings`
 
`coefficients`
 
`landing_fit`
 
`identify`
 
`validate`
 
`learning`
 
`state_selection`
 
`dissertation`
 
`predict_node`
 
|
 
a
 
state
 
to
 
its
 
path
 
through
 
bounces,
 
events
 
exact,
 
and
 
its
 
uncertainty;
 
coefficients
 
from
 
recorded
 
flights,
 
and
 
learnt
 
from
 
ball
 
to
 
ball
 
|
<NL>
|
 
`tt_racket`
 
|
 
`failures`
 
`impact`
 
`solution`
 
`return_flight`
 
`dissertation`
 
`shooting`
 
`stroke`
 
`goal`
 
`goal_relaxation`
 
`sensitivity`
 
`intercept`
 
`followed_ball`
 
`baselines`
 
`racket_node`
 
|
 
a
 
path
 
and
 
a
 
goal
 
to
 
candidate
 
strokes:
 
rebound
 
inverse
 
in
 
closed
 
form,
 
boundary
 
value
 
problem
 
by
 
shooting,
 
what
 
to
 
give
 
up
 
of
 
a
 
goal
 
out
 
of
 
reach;
 
`intercept`
 
goes
 
from
 
the
 
path
 
to
 
ordered
 
strokes
 
|
<NL>
|
 
`tt_arm`
 
|
 
`joints`
 
`arm_urdf/`
 
(`urdf`
 
`meshes`
 
`bodies`
 
`geometry`)
 
`kinematics`
 
`dynamics`
 
`model`
 
`description`
 
`arm_file`
 
`ik/`
 
(`velocity_allocation`
 
`newton`
 
`posture_cost`
 
`posture_search`
 
`closed_form`
 
`elbow_search`)
 
`dissertation`
 
`reach`
 
`trajectory/`
 
(`profiles`
 
`legs`
 
`jerk`
 
`limits`
 
`path`
 
`torque`
 
`path_check`)
 
`swing`
 
`stroke_correction`
 
`stroke_selection`
 
`servo`
 
`safety/`
 
(`stops`
 
`joint_states`
 
`clearance`
 
`body_pairs`
 
`command_limits`
 
`guard`)
 
`startup_check`
 
`control`
 
`position_stream`
 
`arm_node`
 
`enable_node`
 
|
 
a
 
stroke
 
to
 
joint
 
velocities
 
within
 
all
 
limits
 
|
<NL>
|
 
`tt_sim`
 
|
 
`world/`
 
(`launcher`
 
`rotation_machine`
 
`vectors`
 
`racket_motion`
 
`surfaces`
 
`true_ball`
 
`plant`
 
`drive`
 
`arm_record`
 
`outcome`)
 
`render`
 
`cameras/`
 
(`camera_sequence`
 
`camera_faults`
 
`render_worker`
 
`tracking_cameras`)
 
`domain_randomization`
 
`world_file`
 
`simulated_robot`
 
`sim_params`
 
`launch_store`
 
`frame_schedule`
 
`pace`
 
`sim_loop`
 
`sim_node`;
 
`worlds/`
 
|
 
stands
 
in
 
for
 
the
 
hardware:
 
ball,
 
contacts,
 
cameras
 
and
 
arm
 
as
 
they
 
truly
 
are
 
|
<NL>
|
 
`tt_eval`
 
|
 
`rallies`
 
`sensor_error_model`
 
`scenario`
 
`failures`
 
`miss`
 
`fast_swing`
 
`lesson`
 
`contact_watch`
 
`feedback`
 
`episode`
 
`oracle`
 
`video_scoring`
 
`sweep_metrics`
 
`sweep`
 
`evaluate`
 
`sensor_error_fit`
 
`synthetic_bursts`
 
`arm_loop`
 
`arm_trial`
 
`progress`
 
`page`
 
with
 
its
 
template
 
`pages/`
 
`experiments/`
 
`arm_study/`
 
(`placement`
 
`quick_score`
 
`search`
 
`speed_map`
 
`limiting`
 
`arm_page`
 
`main`);
 
`scenarios/`
 
`robots/`
 
`sensor_error_models/`
 
|
 
whole
 
rallies
 
without
 
ROS:
 
scenarios
 
in
 
YAML
 
played
 
by
 
the
 
thousand
 
and
 
scored
 
by
 
the
 
truth
 
and
 
by
 
two
 
wide
 
cameras;
 
the
 
experiments
 
of
 
Chapter
 
2
 
|
<NL>
|
 
`tt_tools`
 
|
 
`errors`
 
`packages`
 
`launch`
 
`bagfile`
 
`record`
 
`reindex`
 
`describe`
 
`node_parameters`
 
`play`
 
`keys`
 
`record_node`
 
`play_node`;
 
the
 
command:
 
`graph`
 
`qos`
 
`message_text`
 
`interface_text`
 
`listen`
 
`publish`
 
`call`
 
`parameter_client`
 
`commands/`
 
(one
 
module
 
for
 
each
 
word)
 
`ros2`
 
|
 
what
 
the
 
wheels
 
lack
 
of
 
ros2cli,
 
launch
 
and
 
rosbag2
 
|
<NL>
|
 
`tt_bringup`
 
|
 
`demo`
 
`demo_metrics`
 
`report/`
 
(`run_record`
 
`ball_images`
 
`arm_pose`
 
`figures`
 
`rally_scene`
 
`words`
 
`run_page`
 
`main`)
 
`frames`
 
`stages`
 
`reprocess`
 
`compare`
 
`parameters`
 
`warm`
 
`view/`
 
(`items`
 
`robot_shapes`
 
`scene`
 
`scene_inputs`
 
`viser_scene`
 
`readings`
 
`actions`
 
`page`
 
`gate`)
 
`learn_node`
 
`marker_node`
 
`view_node`
 
`robot_state_publisher`;
 
`launch/`
 
`config/`
 
|
 
what
 
starts
 
and
 
shows
 
the
 
whole
 
system
 
|
<NL>
<NL>
##
 
The
 
rules
<NL>
<NL>
Held
 
by
 
`tests/test_architecture.py`:
<NL>
-
 
each
 
`tt_*`
 
imports
 
`tt_core`
 
and
 
no
 
sibling,
 
except:
 
`tt_sim`
 
the
 
models
 
of
 
cameras
 
and
 
arm,
 
not
 
the
 
methods
 
that
 
it
 
tests;
 
`tt_eval`
 
all
 
but
<NL>
  
`tt_tools`;
 
`tt_bringup`
 
all;
<NL>
-
 
only
 
`*_node.py`,
 
`tt_core/ros/`,
 
`tt_tools`
 
and
 
the
 
programs
 
of
 
`tt_bringup`
 
import
 
ROS;
 
no
 
algorithm
 
receives
 
a
 
node,
 
a
 
logger
 
or
 
a
 
clock;
<NL>
-
 
code
 
and
 
tests
 
decide
 
on
 
the
 
codes
 
and
 
numbers
 
of
 
a
 
reason
 
(`tt_core.failures.Failure`),
 
never
 
on
 
its
 
words;
<NL>
-
 
no
 
function
 
takes
 
more
 
than
 
eight
 
parameters;
<NL>
-
 
nothing
 
outside
 
`tt_sim`
 
names
 
a
 
topic
 
of
 
the
 
truth,
 
`sim/*`,
 
but
 
the
 
report
 
page,
 
which
 
evaluates
 
recordings,
 
and
 
the
 
view,
 
which
 
shows
 
it
 
to
<NL>
  
people.
<NL>
<NL>
##
 
Where
 
to
 
change
 
what
<NL>
<NL>
|
 
to
 
change
 
|
 
go
 
to
 
|
<NL>
|---|---|
<NL>
|
 
a
 
physical
 
constant,
 
the
 
model
 
of
 
flight
 
or
 
rebound
 
|
 
`tt_core/constants.py`,
 
`flight.py`,
 
`bounce.py`
 
|
<NL>
|
 
how
 
a
 
ball
 
is
 
followed
 
over
 
time
 
|
 
`tt_vision/tracking/`
 
|
<NL>
|
 
what
 
is
 
learnt
 
from
 
ball
 
to
 
ball
 
|
 
`tt_predict/learning.py`,
 
`tt_eval/lesson.py`
 
|
<NL>
|
 
how
 
a
 
swing
 
follows
 
newer
 
strokes
 
|
 
`tt_arm/stroke_correction.py`,
 
`control.py`
 
|
<NL>
|
 
how
 
the
 
ball
 
is
 
found
 
in
 
an
 
image;
 
how
 
its
 
spin
 
is
 
found
 
|
 
`tt_vision/detection/`;
 
`tt_vision/spin/`,
 
called
 
from
 
`measure.py`
 
|
<NL>
|
 
where
 
a
 
path
 
ends,
 
how
 
uncertain
 
it
 
is
 
|
 
`tt_predict/rollout.py`,
 
`uncertainty.py`
 
|
<NL>
|
 
where
 
the
 
ball
 
is
 
hit,
 
what
 
is
 
given
 
up
 
of
 
a
 
goal
 
out
 
of
 
reach
 
|
 
`tt_racket/intercept.py`,
 
`goal_relaxation.py`
 
|
<NL>
|
 
which
 
URDFs
 
can
 
be
 
used;
 
another
 
arm
 
|
 
`tt_arm/arm_urdf/urdf.py`;
 
an
 
arm
 
file,
 
`tt_core/robots.py`,
 
see
 
`docs/arms.md`
 
|
<NL>
|
 
limits
 
of
 
the
 
joints;
 
posture;
 
motion
 
in
 
time
 
|
 
`tt_arm/joints.py`;
 
`reach.py`
 
and
 
`ik/`;
 
`swing.py`
 
and
 
`trajectory/`
 
|
<NL>
|
 
what
 
stops
 
the
 
arm
 
|
 
`tt_arm/safety/`,
 
and
 
`docs/safety.md`
 
with
 
it
 
|
<NL>
|
 
a
 
default,
 
a
 
unit,
 
a
 
range
 
of
 
a
 
parameter
 
|
 
the
 
`param(...)`
 
field
 
beside
 
the
 
algorithm,
 
then
 
`python
 
-m
 
tt_bringup.parameters`
 
(see
 
CONTRIBUTING)
 
|
<NL>
|
 
parameters
 
of
 
the
 
nodes
 
|
 
`tt_bringup/config/parameters.yaml`,
 
or
 
a
 
copy
 
for
 
`params_file:=`
 
|
<NL>
|
 
an
 
arm
 
that
 
comes
 
with
 
it:
 
URDF,
 
base,
 
mount,
 
waiting
 
posture,
 
hit
 
window
 
|
 
`tt_bringup/config/<arm>/`
 
|
<NL>
|
 
a
 
message,
 
quality
 
of
 
service,
 
diagnostics
 
|
 
`tt_core/ros/`
 
|
<NL>
|
 
what
 
is
 
true
 
in
 
the
 
simulator
 
|
 
`tt_sim/world/`,
 
`tt_sim/cameras/`,
 
`tt_sim/worlds/*.yaml`
 
|
<NL>
|
 
what
 
is
 
played
 
and
 
how
 
it
 
is
 
scored
 
|
 
`tt_eval/scenarios/*.yaml`,
 
`tt_eval/episode.py`,
 
`sweep_metrics.py`
 
|
<NL>
|
 
what
 
is
 
drawn
 
in
 
3D,
 
and
 
how
 
long
 
it
 
stays;
 
how
 
it
 
looks
 
in
 
the
 
browser
 
|
 
`tt_bringup/view/scene.py`;
 
`view/page.py`,
 
`view/viser_scene.py`
 
|
<NL>
|
 
what
 
a
 
launch
 
starts
 
|
 
`tt_bringup/launch/*.yaml`
 
|
<NL>
<NL>
Frames,
 
units
 
and
 
topics
 
are
 
in
 
[docs/interfaces.md](docs/interfaces.md),
 
parameters
 
in
 
[docs/parameters.md](docs/parameters.md),
 
what
 
keeps
<NL>
people
 
safe
 
in
 
[docs/safety.md](docs/safety.md),
 
and
 
why
 
things
 
are
 
as
 
they
 
are
 
in
 
[docs/decisions.md](docs/decisions.md).
<NL>
