"""Strips whose equilibria are known by other means; nothing here imports the package under test.

Conventions are those of users. The start's frame has x along the tangent, z along the ruling (for eta = 0)
and y = z cross x; the start's midpoint is the origin. A strip of half-width b has the planar bending
stiffness b, since E = int H^2 da. `force` and `moment` are what the end's clamp exerts on the strip, the
moment about the end's midpoint; `start_force` and `start_moment` are those of the start's clamp, about the
origin. So dU/dspan, dU/dlift and dU/dshear are the components of `force`.
"""
