"""The paper in one room (Sodhi et al., ICRA 2021): images, features, transform_network, graph, study, figures."""
