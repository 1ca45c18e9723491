"""The paper in one room: learning tactile models for factor graph-based state estimation (Sodhi et al., ICRA 2021).

Read in the order of the paper: `images` and `ellipse` (Sec. V-B), `features` and `transform_network` (Sec. IV-A),
`graph` (Sec. III and IV-B), `study` and `figures` (Sec. V).
"""
