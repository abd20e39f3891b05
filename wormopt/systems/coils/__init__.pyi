from wormopt.systems.shared.si import SIScene as SIScene
