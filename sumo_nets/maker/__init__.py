"""Makers of the scenarios in sumo_nets/. `make.py` calls them.

network.py: nodes, edges and connections to a road network, by netconvert
ways.py: fastest ways through a network
programs.py: programs of lights, as greens with yellow and red between them
capacity.py: how many cars an hour the lights of a network can serve
traffic.py: vehicle types, vehicles and flows, and the files of a scenario
grid_4x4_turns.py, town.py, arterial.py: one scenario each
towns.py, islands.py: many islands of lights, others for every seed
city.py: a city, another one for every seed
street_plan.py, city_streets.py, city_traffic.py, city_buses.py: what it is made of
"""
