"""The physics of rack-and-pinion axes, paper section II.

``simulation`` lets a machine of ``parameters`` make the moves of ``trajectory``; ``axis`` and ``gantry`` turn the
parameters into a ``mechanism``, which ``modes`` and ``propagation`` carry through time exactly, from one event of
its ``forces`` to the next; ``controller`` drives it and ``effects`` add what the paper's model lacks.
"""
